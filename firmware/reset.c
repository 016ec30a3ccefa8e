#include "reset.h"

#include <avr/io.h>
#include <avr/wdt.h>

static uint8_t cause __attribute__((section(".noinit")));

/* Before main: after a reset by the watchdog it goes on running, at its shortest time. */
void reset_begin(void) __attribute__((naked, used, section(".init3")));
void reset_begin(void) {
    cause = MCUSR;
    MCUSR = 0;
    wdt_disable();
}

uint8_t reset_cause(void) { return cause; }

void hardware_watchdog_start(void) { wdt_enable(WDTO_30MS); }

void hardware_watchdog_feed(void) { wdt_reset(); }
