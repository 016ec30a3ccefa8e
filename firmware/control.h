/* The PI law on the device. No registers: also compiled for tests. */
#ifndef CONTROL_H
#define CONTROL_H

#include <stdint.h>

#define SPEED_TICKS 8 /* the speed is the motion in as many ticks */

typedef struct {
    int32_t kp, ki; /* duty per unit of error, times 2^16; for each sample, times 2^24 */
    int32_t reference;
    int16_t limit; /* the largest duty */
    int64_t sum;   /* ki times the errors so far, within the limit */
    int32_t before[SPEED_TICKS];
    uint8_t place;
} pi_law;

/* Starts at rest where the shaft is. */
void control_start(pi_law *law, int32_t position);

/* Notes the position at each tick, for the speed. */
void control_tick(pi_law *law, int32_t position);

/* Returns the duty of a sample. `speed` 1: the reference is in counts per second, 0: in counts. The integral stops where the duty
   is at its limit. */
int16_t control_sample(pi_law *law, int32_t position, uint8_t speed);

#endif
