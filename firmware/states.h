/* The states of the drive in the style of CiA 402, and every transition there is. No registers: also compiled for tests. */
#ifndef STATES_H
#define STATES_H

#include <stdint.h>

#include "protocol.h"

typedef enum {
    EVENT_INITIALISED,
    EVENT_CLAIM,
    EVENT_ENABLE,
    EVENT_STOP,
    EVENT_RELEASE,
    EVENT_FAULT,
    EVENT_CLEAR,
} drive_event;

#define NO_TRANSITION 0xff

/* Returns the state that follows, or NO_TRANSITION where the event has no place in this state. */
uint8_t next_state(uint8_t state, drive_event event);

#endif
