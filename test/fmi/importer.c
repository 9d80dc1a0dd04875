// SPDX-License-Identifier: Apache-2.0
/* An importer without Python: loads the library of a unit, runs it, and prints numbers to the last bit. */
#ifdef _WIN32
#include <windows.h>
#define RTLD_NOW 0
static void *dlopen(const char *name, int how) { return (void *)LoadLibraryA(name); }
static void *dlsym(void *library, const char *name) { return (void *)GetProcAddress((HMODULE)library, name); }
static const char *dlerror(void) { return "the library does not load"; }
#else
#include <dlfcn.h>
#endif
#include <stdio.h>
#include <stdlib.h>

typedef struct {
    void (*log)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} callbacks;

static void said(void *environment, const char *name, int status, const char *category, const char *text, ...) {
    fprintf(stderr, "%s: status %d\n", name, status);
}

int main(int count, char **words) {
    void *library = dlopen(words[1], RTLD_NOW);
    if (library == NULL) {
        fprintf(stderr, "%s\n", dlerror());
        return 2;
    }
    void *(*make)(const char *, int, const char *, const char *, const callbacks *, int, int) = dlsym(library, "fmi2Instantiate");
    int (*set_up)(void *, int, double, double, int, double) = dlsym(library, "fmi2SetupExperiment");
    int (*enter)(void *) = dlsym(library, "fmi2EnterInitializationMode");
    int (*leave)(void *) = dlsym(library, "fmi2ExitInitializationMode");
    int (*step)(void *, double, double, int) = dlsym(library, "fmi2DoStep");
    int (*get)(void *, const unsigned[], size_t, double[]) = dlsym(library, "fmi2GetReal");
    callbacks ours = {said, calloc, free, NULL, NULL};
    void *unit = make("unit", 1, words[2], "", &ours, 0, 0);
    int steps = atoi(words[3]);
    double step_s = atof(words[4]);
    if (unit == NULL || set_up(unit, 0, 0.0, 0.0, 0, 0.0) || enter(unit) || leave(unit)) return 3;
    for (int i = 0; i < steps; i++)
        if (step(unit, i * step_s, step_s, 1)) return 4;
    for (int i = 5; i < count; i++) {
        unsigned reference = (unsigned)atoi(words[i]);
        double value = 0.0;
        if (get(unit, &reference, 1, &value)) return 5;
        printf("%a\n", value);
    }
    return 0;
}
