/* The host watchdog: runs from the first actuation on, is fed by actuation alone. No registers: also compiled for tests. */
#ifndef WATCHDOG_H
#define WATCHDOG_H

#include <stdint.h>

typedef struct {
    uint16_t timeout; /* ms */
    uint16_t left;    /* ms; 0 while it doesn't run */
} host_watchdog;

/* Starts it, or starts it again. The tick that is under way isn't a whole one: with `timeout` ticks it trips after timeout - 1
   to timeout ms. */
static inline void watchdog_feed(host_watchdog *watchdog) { watchdog->left = watchdog->timeout; }

static inline void watchdog_rest(host_watchdog *watchdog) { watchdog->left = 0; }

/* Lets a millisecond pass; returns 1 where it trips. */
static inline uint8_t watchdog_tick(host_watchdog *watchdog) {
    return watchdog->left && --watchdog->left == 0;
}

#endif
