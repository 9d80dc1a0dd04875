// SPDX-License-Identifier: Apache-2.0
/*
 * FMI 2.0 for co-simulation over `unit`.
 */
#include <stdlib.h>
#include <string.h>

#include "unit.h"

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef void *fmi2Component, *fmi2ComponentEnvironment, *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef void (*fmi2CallbackLogger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
typedef struct {
    fmi2CallbackLogger logger;
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;
enum { CO_SIMULATION = 1, DO_STEP_STATUS = 0, PENDING_STATUS = 1, LAST_SUCCESSFUL_TIME = 2, TERMINATED = 3 };

static void log_line(void *context, const char *text) {
    unit *it = context;
    if (it->logger != NULL)
        ((fmi2CallbackLogger)it->logger)(it->environment, it->name, fmi2Error, "logStatusError", "%s", text);
}

static fmi2Status refused(fmi2Component c, const char *text) {
    log_line(c, text);
    return fmi2Error;
}

static fmi2Status answered(fmi2Component c, const char *why) {
    return why == NULL ? fmi2OK : refused(c, why);
}

#define NOT_HERE(function) return refused(c, MACHINE_NAME ": " function " is not offered, see modelDescription.xml")

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }

EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    ((unit *)c)->log_on = on;
    return fmi2OK;
}

EXPORT fmi2Component fmi2Instantiate(
    fmi2String name, int type, fmi2String guid, fmi2String resources, const fmi2CallbackFunctions *functions,
    fmi2Boolean visible, fmi2Boolean log_on) {
    unit *it = functions == NULL ? NULL : unit_made(name);
    if (it == NULL) return NULL;
    it->log = log_line;
    it->logger = (void *)functions->logger;
    it->environment = functions->componentEnvironment;
    it->log_on = log_on;
    if (type != CO_SIMULATION || guid == NULL || strcmp(guid, TOKEN) != 0) {
        log_line(it, type != CO_SIMULATION ? MACHINE_NAME ": expected co-simulation"
                                           : MACHINE_NAME ": expected guid " TOKEN ", that of modelDescription.xml");
        unit_ended(it);
        return NULL;
    }
    return it;
}

EXPORT void fmi2FreeInstance(fmi2Component c) { unit_ended(c); }

EXPORT fmi2Status fmi2SetupExperiment(
    fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start_s, fmi2Boolean stop_defined,
    fmi2Real stop_s) {
    ((unit *)c)->state.start_s = start_s;
    return fmi2OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return unit_begin(c) == 0 ? fmi2OK : fmi2Error; }

EXPORT fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }

EXPORT fmi2Status fmi2Reset(fmi2Component c) {
    unit_reset(c);
    return fmi2OK;
}

/* Before the run begins, what depends on parameters and inputs is computed when it is asked for. */
static int computed(unit *it) {
    if (it->state.begun) return 0;
    int wrong = unit_begin(it);
    it->state.begun = 0;
    return wrong;
}

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    if (computed(c) != 0) return fmi2Error;
    for (size_t i = 0; i < n; i++)
        if (unit_get_real(c, vr[i], &value[i]) != 0) return fmi2Error;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
    for (size_t i = 0; i < n; i++)
        if (unit_get_count(c, vr[i], &value[i]) != 0) return fmi2Error;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[]) {
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != MOTOR_GIVEN || EFFORT_COUNT == 0) return refused(c, MACHINE_NAME ": no such truth value");
        value[i] = ((unit *)c)->state.motor_given;
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[]) {
    return n == 0 ? fmi2OK : refused(c, MACHINE_NAME ": holds no strings");
}

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    for (size_t i = 0; i < n; i++)
        if (unit_set_real(c, vr[i], value[i]) != 0) return fmi2Error;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[]) {
    return n == 0 ? fmi2OK : refused(c, MACHINE_NAME ": no whole number can be set");
}

EXPORT fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[]) {
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != MOTOR_GIVEN || EFFORT_COUNT == 0 || ((unit *)c)->state.begun)
            return refused(c, MACHINE_NAME ": no truth value that can be set now");
        ((unit *)c)->state.motor_given = value[i] != 0;
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[]) {
    return n == 0 ? fmi2OK : refused(c, MACHINE_NAME ": holds no strings");
}

EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    return answered(c, unit_store(c, state));
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    return answered(c, unit_restore(c, state));
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    unit_forget(state);
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    *size = sizeof(unit_state);
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    return answered(c, unit_to_bytes(state, bytes, size));
}

EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    return answered(c, unit_from_bytes(bytes, size, state));
}

EXPORT fmi2Status fmi2GetDirectionalDerivative(
    fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns, const fmi2ValueReference known[],
    size_t knowns, const fmi2Real change[], fmi2Real result[]) {
    NOT_HERE("fmi2GetDirectionalDerivative");
}

EXPORT fmi2Status fmi2SetRealInputDerivatives(
    fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], const fmi2Real value[]) {
    NOT_HERE("fmi2SetRealInputDerivatives");
}

EXPORT fmi2Status fmi2GetRealOutputDerivatives(
    fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], fmi2Real value[]) {
    NOT_HERE("fmi2GetRealOutputDerivatives");
}

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time_s, fmi2Real step_s, fmi2Boolean no_state_before) {
    int events = 0;
    return unit_advance(c, time_s, step_s, 0, &events) == 0 ? fmi2OK : fmi2Error;
}

EXPORT fmi2Status fmi2CancelStep(fmi2Component c) { NOT_HERE("fmi2CancelStep"); }

EXPORT fmi2Status fmi2GetStatus(fmi2Component c, int kind, fmi2Status *value) { NOT_HERE("fmi2GetStatus"); }

EXPORT fmi2Status fmi2GetRealStatus(fmi2Component c, int kind, fmi2Real *value) {
    if (kind != LAST_SUCCESSFUL_TIME) NOT_HERE("this status");
    *value = unit_time(c);
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetIntegerStatus(fmi2Component c, int kind, fmi2Integer *value) {
    NOT_HERE("fmi2GetIntegerStatus");
}

EXPORT fmi2Status fmi2GetBooleanStatus(fmi2Component c, int kind, fmi2Boolean *value) {
    if (kind != TERMINATED) NOT_HERE("this status");
    *value = 0;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetStringStatus(fmi2Component c, int kind, fmi2String *value) {
    NOT_HERE("fmi2GetStringStatus");
}
