/* Why the chip started, and the hardware watchdog that starts it again where the main loop hangs. */
#ifndef RESET_H
#define RESET_H

#include <stdint.h>

/* The bits of MCUSR as they were at the start. */
uint8_t reset_cause(void);

void hardware_watchdog_start(void);

/* Only the main loop calls this, and only after a tick has passed. */
void hardware_watchdog_feed(void);

#endif
