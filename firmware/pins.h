/* What is wired where; the names in brackets are those printed on an Uno or a Nano. */
#ifndef PINS_H
#define PINS_H

#include <avr/io.h>

#define ENCODER_A PD2 /* [2], PCINT18 */
#define ENCODER_B PD3 /* [3], PCINT19 */
#define BRIDGE_IN1 PB0 /* [8], high for a positive duty; the DIR of bridges with PWM and DIR */
#define BRIDGE_IN2 PD7 /* [7], high for a negative duty */
#define BRIDGE_PWM PB1 /* [9], OC1A */
#define BRIDGE_ENABLE PB2 /* [10], with a pull-down outside: without firmware the pin floats */
#define LAMP PB5 /* [13], the board's own */
#define CURRENT_CHANNEL 0 /* [A0] */

#endif
