/* The open rig: an ATmega328P between a host and a motor with an encoder. docs/reference/rig-protocol.md says what it does. */
#include <avr/interrupt.h>

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
    sei();
    uint32_t fed = 0;
    for (;;) {
        link_poll();
        uint32_t now = sampling_time();
        if (now != fed) {
            fed = now;
            hardware_watchdog_feed();
        }
    }
}
