// SPDX-License-Identifier: Apache-2.0
#include "unit.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "machine_data.h" /* constants and first frame of the machine, written by the export */

#define ON_STEP 1e-6 /* of a step: a time this little, and its own rounding, before a step counts as on it */
#define MOST_STEPS 9e15 /* as many as a double counts one by one */

/* The compiled kernels, in the calling convention of numba: result, exception, arguments; not 0 is an exception. */
extern int mech_step(
    int64_t *result, void **exception, void *reals, void *wholes, void *flags, int64_t begin, int64_t step,
    double target, void *row, void *events);

static int call(unit *it, int begin, int64_t *told) {
    void *exception = NULL;
    unit_state *s = &it->state;
    return mech_step(
        told, &exception, s->reals, s->wholes, s->flags, begin, s->step, s->command, s->row, s->events);
}

static int told(unit *it, const char *text) {
    if (it->log != NULL) it->log(it, text);
    return -1;
}

static void give_efforts(unit_state *s) {
    if (!s->motor_given) return;
    if (SUPPLY_OFF) s->row[MOTOR_COMMAND_PLACE] = 0.0; /* so that the linkage holds the effort, and not its own curve */
    for (int i = 0; i < EFFORT_COUNT; i++) s->row[EFFORT_PLACES[i]] = s->efforts[i];
}

static void put_parameter(unit_state *s, int i) {
    for (int k = PARAMETER_BEGINS[i]; k < PARAMETER_BEGINS[i + 1]; k++) s->reals[PARAMETER_PLACES[k]] = s->parameters[i];
}

void unit_reset(unit *it) {
    unit_state *s = &it->state;
    memset(s, 0, sizeof *s);
    memcpy(s->token, TOKEN, sizeof s->token);
    if (REAL_COUNT > 0) memcpy(s->reals, REALS, REAL_COUNT * sizeof(double));
    if (WHOLE_COUNT > 0) memcpy(s->wholes, WHOLES, WHOLE_COUNT * sizeof(int64_t));
    if (FLAG_COUNT > 0) memcpy(s->flags, FLAGS, FLAG_COUNT * sizeof(uint8_t));
    memcpy(s->row, FIRST_ROW, sizeof s->row);
    s->command = FIRST_COMMAND;
    for (int i = 0; i < PARAMETER_COUNT; i++) s->parameters[i] = s->reals[PARAMETER_PLACES[PARAMETER_BEGINS[i]]];
    for (int i = 0; i < EFFORT_COUNT; i++) s->efforts[i] = s->row[EFFORT_PLACES[i]];
}

int unit_begin(unit *it) {
    int64_t count = 0;
    if (call(it, 1, &count) != 0) return told(it, MACHINE_NAME ": the first frame cannot be computed");
    give_efforts(&it->state);
    it->state.begun = 1;
    return 0;
}

double unit_time(const unit *it) { return it->state.start_s + (double)it->state.step * STEP_S; }

int unit_advance(unit *it, double time_s, double step_s, int stop_at_event, int *stopped) {
    unit_state *s = &it->state;
    double near = ON_STEP + 2.0 * DBL_EPSILON * fabs(time_s) / STEP_S;
    double last = floor((time_s + step_s - s->start_s) / STEP_S + near);
    char text[300];
    *stopped = 0;
    if (!s->begun) return told(it, MACHINE_NAME ": a step before the initialization has ended");
    if (!(fabs(time_s - unit_time(it)) <= (1.0 + near) * STEP_S && near < 0.5 && step_s >= 0.0 && last <= MOST_STEPS)) { /* so is what is not a number */
        snprintf(
            text, sizeof text, MACHINE_NAME ": a step of %.9g s from %.15g s: expected one onward from where the last ended, %.15g s",
            step_s, time_s, unit_time(it));
        return told(it, text);
    }
    for (int i = 0; i < PARAMETER_COUNT; i++) /* a live one counts from the next step on */
        if (PARAMETER_LIVE[i]) put_parameter(s, i);
    while ((double)s->step < last) {
        int64_t count = 0;
        give_efforts(s);
        int raised = call(it, 0, &count);
        if (raised != 0 || count < 0) {
            const char *reason = "its equations have no finite answer";
            if (raised == 0 && -1 - count < FAILURE_COUNT) reason = FAILURES[-1 - count];
            snprintf(text, sizeof text, MACHINE_NAME ": %s, in the step from %.9g s", reason, unit_time(it));
            return told(it, text);
        }
        s->step++;
        give_efforts(s);
        if (count > 0) {
            *stopped = 1;
            if (stop_at_event) return 0;
        }
    }
    return 0;
}

static int unknown(unit *it, const char *what, unsigned reference) {
    char text[120];
    snprintf(text, sizeof text, MACHINE_NAME ": no %s with value reference %u", what, reference);
    return told(it, text);
}

int unit_get_real(const unit *it, unsigned reference, double *value) {
    const unit_state *s = &it->state;
    if (reference == TIME_REFERENCE) *value = unit_time(it);
    else if (reference == COMMAND) *value = s->command;
    else if (reference >= EFFORTS && reference < EFFORTS + EFFORT_COUNT) *value = s->efforts[reference - EFFORTS];
    else if (reference >= PARAMETERS && reference < PARAMETERS + PARAMETER_COUNT)
        *value = s->parameters[reference - PARAMETERS];
    else if (reference >= FRAME && reference < FRAME + ROW_COUNT) *value = s->row[reference - FRAME];
    else if (reference >= EVENTS && reference < EVENTS + EVENT_FIELDS * KIND_COUNT) {
        unsigned field = (reference - EVENTS) % EVENT_FIELDS;
        if (field == EVENT_COUNT) return unknown((unit *)it, "number", reference);
        *value = s->events[(reference - EVENTS) / EVENT_FIELDS][field];
        if (field == EVENT_TIME) *value += s->start_s;
    } else return unknown((unit *)it, "number", reference);
    return 0;
}

int unit_get_count(const unit *it, unsigned reference, int32_t *value) {
    if (reference < EVENTS || reference >= EVENTS + EVENT_FIELDS * KIND_COUNT || (reference - EVENTS) % EVENT_FIELDS)
        return unknown((unit *)it, "whole number", reference);
    *value = (int32_t)it->state.events[(reference - EVENTS) / EVENT_FIELDS][EVENT_COUNT];
    return 0;
}

int unit_set_real(unit *it, unsigned reference, double value) {
    unit_state *s = &it->state;
    char text[300];
    if (!isfinite(value)) {
        int is_parameter = reference >= PARAMETERS && reference < PARAMETERS + PARAMETER_COUNT;
        const char *name = is_parameter ? PARAMETER_NAMES[reference - PARAMETERS] : reference == COMMAND ? "speed_command" : "input";
        snprintf(text, sizeof text, MACHINE_NAME ": %s (value reference %u), value %g: expected a finite number", name, reference, value);
        return told(it, text);
    }
    if (reference == COMMAND) s->command = value;
    else if (reference >= EFFORTS && reference < EFFORTS + EFFORT_COUNT) s->efforts[reference - EFFORTS] = value;
    else if (reference >= PARAMETERS && reference < PARAMETERS + PARAMETER_COUNT) {
        unsigned i = reference - PARAMETERS;
        if (s->begun && !PARAMETER_LIVE[i]) {
            snprintf(text, sizeof text, MACHINE_NAME ": parameter %s is fixed once the run has begun", PARAMETER_NAMES[i]);
            return told(it, text);
        }
        if (value < PARAMETER_LEAST[i] || value > PARAMETER_GREATEST[i]) {
            snprintf(
                text, sizeof text, MACHINE_NAME ": parameter %s, value %.15g: expected %s; export anew for others",
                PARAMETER_NAMES[i], value, PARAMETER_RANGES[i]);
            return told(it, text);
        }
        s->parameters[i] = value;
        if (!PARAMETER_LIVE[i]) put_parameter(s, (int)i);
    } else return unknown(it, "input or parameter", reference);
    return 0;
}

unit *unit_made(const char *name) {
    unit *it = calloc(1, sizeof(unit));
    if (it == NULL) return NULL;
    size_t length = name == NULL ? 0 : strlen(name);
    it->name = calloc(length + 1, 1);
    if (it->name == NULL) {
        free(it);
        return NULL;
    }
    if (length) memcpy(it->name, name, length);
    unit_reset(it);
    return it;
}

void unit_ended(unit *it) {
    if (it == NULL) return;
    free(it->name);
    free(it);
}

const char *unit_store(const unit *it, void **state) {
    return unit_from_bytes(&it->state, sizeof(unit_state), state);
}

static const char *foreign(const void *state) {
    int own = state != NULL && memcmp(((const unit_state *)state)->token, TOKEN, sizeof TOKEN) == 0;
    return own ? NULL : MACHINE_NAME ": this is no state of this unit: expected one that it, or an equal export, has stored";
}

const char *unit_restore(unit *it, const void *state) {
    const char *why = foreign(state);
    if (why == NULL) memcpy(&it->state, state, sizeof(unit_state));
    return why;
}

void unit_forget(void **state) {
    if (state == NULL) return;
    free(*state);
    *state = NULL;
}

const char *unit_to_bytes(const void *state, void *bytes, size_t size) {
    if (size < sizeof(unit_state)) return MACHINE_NAME ": too few bytes for a state";
    const char *why = foreign(state);
    if (why != NULL) return why;
    memcpy(bytes, state, sizeof(unit_state));
    return NULL;
}

const char *unit_from_bytes(const void *bytes, size_t size, void **state) {
    const char *why = foreign(size == sizeof(unit_state) ? bytes : NULL);
    if (why != NULL) return why;
    if (*state == NULL) *state = malloc(sizeof(unit_state));
    if (*state == NULL) return MACHINE_NAME ": no memory for a state";
    memcpy(*state, bytes, size);
    return NULL;
}
