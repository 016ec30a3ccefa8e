#include "quadrature.h"

#include <avr/interrupt.h>
#include <avr/io.h>

#include "pins.h"

#define ILLEGAL 2

/* By previous state << 2 | new state, where bit 0 is A and bit 1 is B: both at once is one edge too many. */
static const int8_t steps[16] = {0, 1, -1, ILLEGAL, -1, 0, ILLEGAL, 1, 1, ILLEGAL, 0, -1, ILLEGAL, -1, 1, 0};

static volatile uint16_t count, errors;
static uint8_t state;

static inline uint8_t levels(void) { return PIND >> ENCODER_A & 3; }

void quadrature_init(void) {
    DDRD &= (uint8_t) ~(_BV(ENCODER_A) | _BV(ENCODER_B));
    PORTD |= _BV(ENCODER_A) | _BV(ENCODER_B); /* pull-ups, for encoders with open collectors */
    state = levels();
    PCMSK2 = _BV(PCINT18) | _BV(PCINT19);
    PCIFR = _BV(PCIF2);
    PCICR = _BV(PCIE2);
}

uint16_t quadrature_count(void) { return count; }

uint16_t quadrature_errors(void) { return errors; }

ISR(PCINT2_vect) {
    uint8_t now = levels();
    int8_t step = steps[state << 2 | now];
    state = now;
    if (step == ILLEGAL)
        errors++;
    else
        count += (uint16_t)(int16_t)step;
}
