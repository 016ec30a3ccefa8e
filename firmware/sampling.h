/* The device's clock: timer 2 makes a tick of 1 ms, in which everything is latched and put out. */
#ifndef SAMPLING_H
#define SAMPLING_H

#include <stdint.h>

typedef struct {
    uint32_t time; /* ticks */
    int32_t position;
    int16_t duty;  /* put out at the latch */
    uint16_t age;  /* for how long it had been [4 us] */
    int16_t after; /* put out from the latch on */
    uint16_t current;
} sample;

/* What the tick shares with the main loop is touched by that between these two: a tick that comes meanwhile is made up for at the
   end, and the encoder doesn't wait at all. To mask the timer's interrupt would do the same, but simavr 1.6 forgets an interrupt
   that comes while it is masked. */
void sampling_lock(void);
void sampling_unlock(void);

void sampling_init(void);

/* Begins with the next tick, with a sample in every `period` ticks; 0 ends it. */
void sampling_start(uint8_t period);

uint8_t sampling_period(void);

/* Returns the oldest sample that wasn't taken yet, or 0; `sampling_drop` takes it away. */
const sample *sampling_oldest(void);
void sampling_drop(void);

/* How many samples wait. */
uint8_t sampling_waiting(void);

/* Changes with each tick and each sample that is complete. */
uint8_t sampling_events(void);

/* Ticks since the start. */
uint32_t sampling_time(void);

int32_t sampling_position(void);
void sampling_set_position(int32_t position);

/* Ticks or samples that were lost, since the start. */
uint16_t sampling_lost(void);

/* The time now in steps of 4 us, wrapping; call under the lock or from the tick. */
uint32_t sampling_now(void);

#endif
