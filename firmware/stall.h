/* The stall monitor: a duty beyond a threshold, and a shaft that doesn't move. No registers: also compiled for tests. */
#ifndef STALL_H
#define STALL_H

#include <stdint.h>

typedef struct {
    uint16_t threshold; /* duty */
    int32_t anchor;     /* counts; where the shaft was when it last moved */
    uint16_t still;     /* ms without motion beyond the threshold */
} stall_monitor;

/* Lets a millisecond pass with this position and duty; returns for how long the shaft has been stalled [ms]. */
uint16_t stall_tick(stall_monitor *monitor, int32_t position, int16_t duty);

#endif
