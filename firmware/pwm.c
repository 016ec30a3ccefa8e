#include "pwm.h"

#include <avr/io.h>

#include "pins.h"
#include "protocol.h"

/* Fast PWM with ten bits (mode 7) at 16 MHz / 1024 = 15.6 kHz. Mode 14 would allow 20 kHz, but simavr 1.6 doesn't simulate its
   pin (buserror/simavr#579), and what is flashed is to be what was tested. */
#define PWM_MODE_A (_BV(WGM11) | _BV(WGM10))
#define PWM_MODE_B (_BV(WGM12) | _BV(CS10))

void pwm_init(void) {
    PORTB &= (uint8_t) ~(_BV(BRIDGE_IN1) | _BV(BRIDGE_PWM) | _BV(BRIDGE_ENABLE));
    PORTD &= (uint8_t)~_BV(BRIDGE_IN2);
    DDRB |= _BV(BRIDGE_IN1) | _BV(BRIDGE_PWM) | _BV(BRIDGE_ENABLE) | _BV(LAMP);
    DDRD |= _BV(BRIDGE_IN2);
    TCCR1A = PWM_MODE_A;
    TCCR1B = PWM_MODE_B;
}

static int8_t direction;

/* Even with OCR1A = 0 the timer puts out a pulse of one count: at zero the pin is taken from it. */
static inline void disconnect(void) {
    TCCR1A = PWM_MODE_A;
    PORTB &= (uint8_t)~_BV(BRIDGE_PWM);
}

static void turn(int8_t to) {
    if (to == direction)
        return;
    disconnect();
    PORTB &= (uint8_t)~_BV(BRIDGE_IN1);
    PORTD &= (uint8_t)~_BV(BRIDGE_IN2);
    if (to > 0)
        PORTB |= _BV(BRIDGE_IN1);
    if (to < 0)
        PORTD |= _BV(BRIDGE_IN2);
    direction = to;
}

/* With a direction and without PWM the bridge shorts the motor, which is 0 V; without a direction it would let go of it. */
void pwm_enable(void) {
    turn(1);
    disconnect();
    PORTB |= _BV(BRIDGE_ENABLE) | _BV(LAMP);
}

void pwm_off(void) {
    disconnect();
    PORTB &= (uint8_t) ~(_BV(BRIDGE_ENABLE) | _BV(LAMP));
    turn(0);
}

void pwm_set(int16_t duty) {
    if (duty == 0) {
        disconnect();
        return;
    }
    turn(duty > 0 ? 1 : -1);
    if (duty == DUTY_FULL || duty == -DUTY_FULL) { /* without the timer: simavr puts out nothing at OCR1A = TOP */
        disconnect();
        PORTB |= _BV(BRIDGE_PWM);
        return;
    }
    OCR1A = (uint16_t)((duty > 0 ? duty : -duty) - 1); /* high for OCR1A + 1 of 1024 counts, from the next period on */
    TCCR1A = PWM_MODE_A | _BV(COM1A1);
}
