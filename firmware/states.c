#include "states.h"

typedef struct {
    uint8_t state, event, next;
} transition;

/* Rows are looked for from the top; what isn't here doesn't happen. */
static const transition transitions[] = {
    {STATE_NOT_READY, EVENT_INITIALISED, STATE_SWITCH_ON_DISABLED},
    {STATE_SWITCH_ON_DISABLED, EVENT_CLAIM, STATE_READY},
    {STATE_READY, EVENT_CLAIM, STATE_READY},
    {STATE_READY, EVENT_ENABLE, STATE_OPERATION_ENABLED},
    {STATE_READY, EVENT_RELEASE, STATE_SWITCH_ON_DISABLED},
    {STATE_OPERATION_ENABLED, EVENT_STOP, STATE_READY},
    {STATE_SWITCH_ON_DISABLED, EVENT_STOP, STATE_SWITCH_ON_DISABLED},
    {STATE_READY, EVENT_STOP, STATE_READY},
    {STATE_FAULT, EVENT_STOP, STATE_FAULT},
    {STATE_NOT_READY, EVENT_FAULT, STATE_FAULT},
    {STATE_SWITCH_ON_DISABLED, EVENT_FAULT, STATE_FAULT},
    {STATE_READY, EVENT_FAULT, STATE_FAULT},
    {STATE_OPERATION_ENABLED, EVENT_FAULT, STATE_FAULT},
    {STATE_FAULT, EVENT_FAULT, STATE_FAULT},
    {STATE_FAULT, EVENT_CLEAR, STATE_SWITCH_ON_DISABLED},
};

uint8_t next_state(uint8_t state, drive_event event) {
    for (uint8_t i = 0; i < sizeof transitions / sizeof transitions[0]; i++)
        if (transitions[i].state == state && transitions[i].event == event)
            return transitions[i].next;
    return NO_TRANSITION;
}
