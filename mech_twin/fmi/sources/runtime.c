// SPDX-License-Identifier: Apache-2.0
/*
 * What compiled kernels ask of numba's runtime: memory for arrays, counted.  The layout of a block is that of
 * NRT_MemInfo of numba; the kernels read its `data` and change its `count` themselves.
 */
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

typedef void (*destructor)(void *data, size_t size, void *info);

typedef struct {
    size_t count;
    destructor end;
    void *info;
    void *data;
    size_t size;
    void *allocator;
} block;

void *NRT_Allocate(size_t size) { return malloc(size); }

void NRT_Free(void *memory) { free(memory); }

/* An array in the same piece of memory as its block, aligned as asked: freed as one. */
block *NRT_MemInfo_alloc_aligned(size_t size, unsigned align) {
    size_t room = align ? align : 1;
    block *made = malloc(sizeof(block) + size + 2 * room);
    if (made == NULL) return NULL;
    uintptr_t data = (uintptr_t)made + sizeof(block);
    data += (room - data % room) % room;
    *made = (block){1, NULL, NULL, (void *)data, size, NULL};
    return made;
}

block *NRT_MemInfo_alloc(size_t size) { return NRT_MemInfo_alloc_aligned(size, 16); }

block *NRT_MemInfo_alloc_safe(size_t size) { return NRT_MemInfo_alloc_aligned(size, 16); }

block *NRT_MemInfo_alloc_safe_aligned(size_t size, unsigned align) { return NRT_MemInfo_alloc_aligned(size, align); }

/* A block whose memory may move: lists of the compiler, in the text of an error that nobody reads here. */
block *NRT_MemInfo_new_varsize_dtor(size_t size, destructor end) {
    block *made = malloc(sizeof(block));
    if (made == NULL) return NULL;
    *made = (block){1, end, NULL, malloc(size), size, made};
    if (made->data == NULL) {
        free(made);
        return NULL;
    }
    return made;
}

void *NRT_MemInfo_varsize_realloc(block *held, size_t size) {
    void *moved = realloc(held->data, size);
    if (moved == NULL) return NULL;
    held->data = moved;
    held->size = size;
    return moved;
}

void NRT_MemInfo_call_dtor(block *held) {
    if (held->end != NULL) held->end(held->data, held->size, held->info);
    if (held->allocator == held) free(held->data);
    free(held);
}

/* The steps of an array without gaps in another shape; 0 if it has gaps, which the kernels report as an error. */
int numba_attempt_nocopy_reshape(
    intptr_t dimensions, const intptr_t *lengths, const intptr_t *steps, intptr_t others, const intptr_t *other_lengths,
    intptr_t *other_steps, intptr_t item, int by_columns) {
    intptr_t step = item, other_step = item;
    if (by_columns) return 0;
    for (intptr_t i = dimensions - 1; i >= 0; i--) {
        if (lengths[i] > 1 && steps[i] != step) return 0;
        step *= lengths[i];
    }
    for (intptr_t i = others - 1; i >= 0; i--) {
        other_steps[i] = other_step;
        other_step *= other_lengths[i];
    }
    return step == other_step;
}
