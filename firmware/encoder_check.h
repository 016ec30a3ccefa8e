/* The encoder check: illegal transitions beside motion in a window. No registers: also compiled for tests. */
#ifndef ENCODER_CHECK_H
#define ENCODER_CHECK_H

#include <stdint.h>

typedef struct {
    uint8_t elapsed;        /* ms of the window */
    uint16_t errors_before; /* at its beginning */
    uint32_t motion;        /* counts either way in the window */
} encoder_check;

/* Lets a millisecond pass with this change of position and the number of illegal transitions since the start; returns 1 where
   the window that ends with it had too many. */
uint8_t encoder_check_tick(encoder_check *check, int16_t change, uint16_t errors);

#endif
