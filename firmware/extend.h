/* A counter of 16 bits as one of 32. No registers: also compiled for tests. */
#ifndef EXTEND_H
#define EXTEND_H

#include <stdint.h>

/* Returns how far the narrow counter went since it was `before`: right as long as that is less than half of its range. */
static inline int16_t counter_change(uint16_t now, uint16_t before) { return (int16_t)(uint16_t)(now - before); }

/* Returns the wide position that far on; it wraps at 32 bits as the host expects. */
static inline int32_t position_after(int32_t position, int16_t change) {
    return (int32_t)((uint32_t)position + (uint32_t)(int32_t)change);
}

#endif
