// SPDX-License-Identifier: Apache-2.0
/*
 * FMI 3.0 for co-simulation, with event mode, over `unit`.
 */
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "unit.h"

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef void *fmi3Instance, *fmi3InstanceEnvironment, *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef double fmi3Float64;
typedef int32_t fmi3Int32;
typedef bool fmi3Boolean, fmi3Clock;
typedef const char *fmi3String;
typedef uint8_t fmi3Byte;
typedef const fmi3Byte *fmi3Binary;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);

static void log_line(void *context, const char *text) {
    unit *it = context;
    if (it->logger != NULL) ((fmi3LogMessageCallback)it->logger)(it->environment, fmi3Error, "logStatusError", text);
}

static fmi3Status refused(fmi3Instance c, const char *text) {
    log_line(c, text);
    return fmi3Error;
}

static fmi3Status answered(fmi3Instance c, const char *why) {
    return why == NULL ? fmi3OK : refused(c, why);
}

#define NOT_HERE(function) return refused(c, MACHINE_NAME ": " function " is not offered, see modelDescription.xml")
#define ABSENT(name, ...) \
    EXPORT fmi3Status name(fmi3Instance c, __VA_ARGS__) { NOT_HERE(#name); }
#define REFERENCES const fmi3ValueReference vr[], size_t n
#define NO_TYPE(kind, type) \
    EXPORT fmi3Status fmi3Get##kind(fmi3Instance c, REFERENCES, type value[], size_t values) { \
        if (n == 0) return fmi3OK; \
        NOT_HERE("fmi3Get" #kind); \
    } \
    EXPORT fmi3Status fmi3Set##kind(fmi3Instance c, REFERENCES, const type value[], size_t values) { \
        if (n == 0) return fmi3OK; \
        NOT_HERE("fmi3Set" #kind); \
    }

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[]) {
    ((unit *)c)->log_on = on;
    return fmi3OK;
}

EXPORT fmi3Instance fmi3InstantiateModelExchange(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean log_on,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger) {
    if (logger != NULL) logger(environment, fmi3Error, "logStatusError", MACHINE_NAME ": expected co-simulation");
    return NULL;
}

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean log_on,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger, void *clock, void *lock, void *unlock) {
    return fmi3InstantiateModelExchange(name, token, resources, visible, log_on, environment, logger);
}

EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean log_on,
    fmi3Boolean events_used, fmi3Boolean early_return, const fmi3ValueReference intermediate[], size_t intermediates,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger, void *update) {
    unit *it = unit_made(name);
    if (it == NULL) return NULL;
    it->log = log_line;
    it->logger = (void *)logger;
    it->environment = environment;
    it->log_on = log_on;
    it->events_used = events_used;
    it->early_return = early_return;
    if (token == NULL || strcmp(token, TOKEN) != 0 || intermediates != 0) {
        log_line(it, intermediates ? MACHINE_NAME ": no intermediate values are offered"
                                   : MACHINE_NAME ": expected token " TOKEN ", that of modelDescription.xml");
        unit_ended(it);
        return NULL;
    }
    return it;
}

EXPORT void fmi3FreeInstance(fmi3Instance c) { unit_ended(c); }

EXPORT fmi3Status fmi3EnterInitializationMode(
    fmi3Instance c, fmi3Boolean tolerance_defined, fmi3Float64 tolerance, fmi3Float64 start_s, fmi3Boolean stop_defined,
    fmi3Float64 stop_s) {
    ((unit *)c)->state.start_s = start_s;
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return unit_begin(c) == 0 ? fmi3OK : fmi3Error; }

EXPORT fmi3Status fmi3EnterEventMode(fmi3Instance c) { return fmi3OK; }

EXPORT fmi3Status fmi3EnterStepMode(fmi3Instance c) { return fmi3OK; }

EXPORT fmi3Status fmi3Terminate(fmi3Instance c) { return fmi3OK; }

EXPORT fmi3Status fmi3Reset(fmi3Instance c) {
    unit_reset(c);
    return fmi3OK;
}

EXPORT fmi3Status fmi3UpdateDiscreteStates(
    fmi3Instance c, fmi3Boolean *again, fmi3Boolean *end, fmi3Boolean *nominals, fmi3Boolean *values,
    fmi3Boolean *next_defined, fmi3Float64 *next_s) {
    *again = *end = *nominals = *values = *next_defined = false;
    *next_s = 0.0;
    return fmi3OK;
}

EXPORT fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c) { return fmi3OK; }

/* Before the run begins, what depends on parameters and inputs is computed when it is asked for. */
static int computed(unit *it) {
    if (it->state.begun) return 0;
    int wrong = unit_begin(it);
    it->state.begun = 0;
    return wrong;
}

EXPORT fmi3Status fmi3GetFloat64(fmi3Instance c, REFERENCES, fmi3Float64 value[], size_t values) {
    if (values != n || computed(c) != 0) return fmi3Error;
    for (size_t i = 0; i < n; i++)
        if (unit_get_real(c, vr[i], &value[i]) != 0) return fmi3Error;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(fmi3Instance c, REFERENCES, const fmi3Float64 value[], size_t values) {
    if (values != n) return fmi3Error;
    for (size_t i = 0; i < n; i++)
        if (unit_set_real(c, vr[i], value[i]) != 0) return fmi3Error;
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetInt32(fmi3Instance c, REFERENCES, fmi3Int32 value[], size_t values) {
    if (values != n) return fmi3Error;
    for (size_t i = 0; i < n; i++)
        if (unit_get_count(c, vr[i], &value[i]) != 0) return fmi3Error;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetInt32(fmi3Instance c, REFERENCES, const fmi3Int32 value[], size_t values) {
    return n == 0 ? fmi3OK : refused(c, MACHINE_NAME ": no whole number can be set");
}

EXPORT fmi3Status fmi3GetBoolean(fmi3Instance c, REFERENCES, fmi3Boolean value[], size_t values) {
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != MOTOR_GIVEN || EFFORT_COUNT == 0) return refused(c, MACHINE_NAME ": no such truth value");
        value[i] = ((unit *)c)->state.motor_given != 0;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetBoolean(fmi3Instance c, REFERENCES, const fmi3Boolean value[], size_t values) {
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != MOTOR_GIVEN || EFFORT_COUNT == 0 || ((unit *)c)->state.begun)
            return refused(c, MACHINE_NAME ": no truth value that can be set now");
        ((unit *)c)->state.motor_given = value[i];
    }
    return fmi3OK;
}

NO_TYPE(Float32, float)
NO_TYPE(Int8, int8_t)
NO_TYPE(UInt8, uint8_t)
NO_TYPE(Int16, int16_t)
NO_TYPE(UInt16, uint16_t)
NO_TYPE(UInt32, uint32_t)
NO_TYPE(Int64, int64_t)
NO_TYPE(UInt64, uint64_t)
NO_TYPE(String, fmi3String)
ABSENT(fmi3GetBinary, REFERENCES, size_t sizes[], fmi3Binary value[], size_t values)
ABSENT(fmi3SetBinary, REFERENCES, const size_t sizes[], const fmi3Binary value[], size_t values)
ABSENT(fmi3GetClock, REFERENCES, fmi3Clock value[])
ABSENT(fmi3SetClock, REFERENCES, const fmi3Clock value[])
ABSENT(fmi3GetNumberOfVariableDependencies, fmi3ValueReference vr, size_t *count)
ABSENT(fmi3GetVariableDependencies, fmi3ValueReference vr, size_t of[], fmi3ValueReference on[], size_t at[], int kinds[], size_t n)
ABSENT(fmi3GetDirectionalDerivative, REFERENCES, const fmi3ValueReference known[], size_t knowns, const double seed[], size_t seeds, double result[], size_t results)
ABSENT(fmi3GetAdjointDerivative, REFERENCES, const fmi3ValueReference known[], size_t knowns, const double seed[], size_t seeds, double result[], size_t results)
ABSENT(fmi3GetIntervalDecimal, REFERENCES, double interval[], int kind[])
ABSENT(fmi3GetIntervalFraction, REFERENCES, uint64_t count[], uint64_t resolution[], int kind[])
ABSENT(fmi3GetShiftDecimal, REFERENCES, double shift[])
ABSENT(fmi3GetShiftFraction, REFERENCES, uint64_t count[], uint64_t resolution[])
ABSENT(fmi3SetIntervalDecimal, REFERENCES, const double interval[])
ABSENT(fmi3SetIntervalFraction, REFERENCES, const uint64_t count[], const uint64_t resolution[])
ABSENT(fmi3SetShiftDecimal, REFERENCES, const double shift[])
ABSENT(fmi3SetShiftFraction, REFERENCES, const uint64_t count[], const uint64_t resolution[])
ABSENT(fmi3CompletedIntegratorStep, fmi3Boolean kept, fmi3Boolean *event, fmi3Boolean *end)
ABSENT(fmi3SetTime, double time_s)
ABSENT(fmi3SetContinuousStates, const double state[], size_t n)
ABSENT(fmi3GetContinuousStateDerivatives, double derivative[], size_t n)
ABSENT(fmi3GetEventIndicators, double indicator[], size_t n)
ABSENT(fmi3GetContinuousStates, double state[], size_t n)
ABSENT(fmi3GetNominalsOfContinuousStates, double nominal[], size_t n)
ABSENT(fmi3GetNumberOfEventIndicators, size_t *n)
ABSENT(fmi3GetNumberOfContinuousStates, size_t *n)
ABSENT(fmi3GetOutputDerivatives, REFERENCES, const fmi3Int32 order[], double value[], size_t values)
ABSENT(fmi3ActivateModelPartition, fmi3ValueReference clock, double time_s)

EXPORT fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) { NOT_HERE("fmi3EnterContinuousTimeMode"); }

EXPORT fmi3Status fmi3EnterConfigurationMode(fmi3Instance c) { NOT_HERE("fmi3EnterConfigurationMode"); }

EXPORT fmi3Status fmi3ExitConfigurationMode(fmi3Instance c) { NOT_HERE("fmi3ExitConfigurationMode"); }

EXPORT fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) {
    return answered(c, unit_store(c, state));
}

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) {
    return answered(c, unit_restore(c, state));
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) {
    unit_forget(state);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size) {
    *size = sizeof(unit_state);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    return answered(c, unit_to_bytes(state, bytes, size));
}

EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
    return answered(c, unit_from_bytes(bytes, size, state));
}

EXPORT fmi3Status fmi3DoStep(
    fmi3Instance c, fmi3Float64 time_s, fmi3Float64 step_s, fmi3Boolean no_state_before, fmi3Boolean *event,
    fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *last_s) {
    unit *it = c;
    int happened = 0;
    *end = *early = *event = false;
    if (unit_advance(it, time_s, step_s, it->events_used && it->early_return, &happened) != 0) return fmi3Error;
    *last_s = time_s + step_s;
    *event = it->events_used && happened;
    if (*event && it->early_return && unit_time(it) < *last_s - 0.5 * STEP_S) {
        *early = true;
        *last_s = unit_time(it);
    }
    return fmi3OK;
}
