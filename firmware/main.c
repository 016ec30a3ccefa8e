/* The open rig: an ATmega328P between a host and a motor with an encoder. docs/reference/rig-protocol.md says what it does. */
#include <avr/interrupt.h>
#include <avr/sleep.h>

#include "drive.h"
#include "link.h"
#include "quadrature.h"
#include "reset.h"
#include "sampling.h"
#include "serial.h"

int main(void) {
    drive_init(reset_cause()); /* the bridge first: its pins have floated until now */
    quadrature_init();
    serial_init();
    sampling_init();
    hardware_watchdog_start();
    set_sleep_mode(SLEEP_MODE_IDLE);
    sleep_enable();
    sei();
    uint32_t fed = 0;
    for (;;) {
        uint8_t seen = sampling_events();
        uint8_t waits = link_poll();
        uint32_t now = sampling_time();
        if (now != fed) {
            fed = now;
            hardware_watchdog_feed();
        }
        if (waits)
            continue;
        cli();
        if (serial_is_empty() && sampling_events() == seen) {
            sei(); /* what came meanwhile is served after the next instruction: it ends the sleep, and isn't slept through */
            sleep_cpu();
        }
        sei();
    }
}
