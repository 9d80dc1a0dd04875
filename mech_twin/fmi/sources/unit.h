// SPDX-License-Identifier: Apache-2.0
/*
 * One instance of a machine as plain memory, and what both versions of the standard do with it.  Everything the machine
 * remembers is in `state`: a copy of it is a state that can be stored and given back.
 */
#ifndef UNIT_H
#define UNIT_H

#include <stddef.h>
#include <stdint.h>

#include "machine.h" /* sizes and names of the machine, written by the export */

/* value references; those of one group follow each other */
enum { TIME_REFERENCE = 0, COMMAND = 1, MOTOR_GIVEN = 2, EFFORTS = 100, PARAMETERS = 10000, FRAME = 100000, EVENTS = 1000000 };
enum { EVENT_FIELDS = 5, EVENT_COUNT = 0, EVENT_TIME = 1 };
enum { SINGLE_EFFORTS = EFFORT_COUNT > 0 ? EFFORT_COUNT : 1 };

typedef struct {
    void *none;             /* NULL: fmusim frees what a state begins with, not what it is told the address of */
    char token[sizeof TOKEN]; /* of the unit whose state this is: constants and their places are its own */
    double reals[REAL_COUNT > 0 ? REAL_COUNT : 1]; /* kernels work in arrays of all three */
    int64_t wholes[WHOLE_COUNT > 0 ? WHOLE_COUNT : 1];
    uint8_t flags[FLAG_COUNT > 0 ? FLAG_COUNT : 1];
    int64_t step;           /* coupling steps taken */
    double start_s;         /* time of the importer at step 0 */
    double command;         /* asked fraction of rated supply frequency */
    double efforts[SINGLE_EFFORTS];
    double parameters[PARAMETER_COUNT > 0 ? PARAMETER_COUNT : 1];
    int32_t motor_given;    /* whether the efforts of the motor come from the importer */
    int32_t begun;
    double row[ROW_COUNT];  /* the frame: time, linkage, motor, forces, body */
    double events[KIND_COUNT > 0 ? KIND_COUNT : 1][EVENT_FIELDS];
} unit_state;

typedef void (*unit_log)(void *context, const char *text);

typedef struct {
    unit_state state;
    unit_log log;
    void *context;
    void *environment;      /* of the version of the standard */
    void *logger;
    char *name;
    int log_on;
    int events_used;
    int early_return;
} unit;

void unit_reset(unit *it);
int unit_begin(unit *it);
/* Takes the coupling steps that end within a step of the importer; stops after one with an event where asked.
   0 if it succeeded. */
int unit_advance(unit *it, double time_s, double step_s, int stop_at_event, int *stopped);
double unit_time(const unit *it);
int unit_get_real(const unit *it, unsigned reference, double *value);
int unit_set_real(unit *it, unsigned reference, double value);
int unit_get_count(const unit *it, unsigned reference, int32_t *value);
/* A state of its own for the importer.  What can fail returns why, or NULL. */
const char *unit_store(const unit *it, void **state);
const char *unit_restore(unit *it, const void *state);
void unit_forget(void **state);
const char *unit_to_bytes(const void *state, void *bytes, size_t size);
const char *unit_from_bytes(const void *bytes, size_t size, void **state);
unit *unit_made(const char *name);
void unit_ended(unit *it);

#endif
