#include "quadrature.h"

#include <avr/interrupt.h>
#include <avr/io.h>

#include "pins.h"

/* The pins as the last interrupt saw them, and the count, in registers that one instruction reaches. */
#define SEEN GPIOR0
#define COUNT_LOW GPIOR1
#define COUNT_HIGH GPIOR2

static volatile uint16_t errors __attribute__((used));

void quadrature_init(void) {
    DDRD &= (uint8_t) ~(_BV(ENCODER_A) | _BV(ENCODER_B));
    PORTD |= _BV(ENCODER_A) | _BV(ENCODER_B); /* pull-ups, for encoders with open collectors */
    COUNT_LOW = COUNT_HIGH = 0;
    SEEN = PIND;
    PCMSK2 = _BV(PCINT18) | _BV(PCINT19);
    PCIFR = _BV(PCIF2);
    PCICR = _BV(PCIE2);
}

uint16_t quadrature_count(void) { return (uint16_t)(COUNT_HIGH << 8 | COUNT_LOW); }

uint16_t quadrature_errors(void) { return errors; }

/* By hand: 43 cycles an edge where the compiler takes 81, out of the 160 that there are at 100,000 counts a second.
   Of the 16 pairs of states before and after, the four without a change are none, the four where A and B changed both are
   illegal, and the others are forward where A before equals B after, backward where it doesn't. */
ISR(PCINT2_vect, ISR_NAKED) {
    __asm__ volatile("push r24\n\t"
                     "in r24, __SREG__\n\t"
                     "push r24\n\t"
                     "push r25\n\t"
                     "in r24, %[pins]\n\t"
                     "in r25, %[seen]\n\t"
                     "out %[seen], r24\n\t"
                     "eor r24, r25\n\t" /* what changed */
                     "andi r24, %[both]\n\t"
                     "breq 4f\n\t"
                     "cpi r24, %[both]\n\t"
                     "breq 3f\n\t"
                     "eor r24, r25\n\t" /* after */
                     "lsl r25\n\t"      /* A before, where B is */
                     "eor r24, r25\n\t"
                     "in r25, %[low]\n\t"
                     "sbrc r24, %[b]\n\t"
                     "rjmp 1f\n\t"
                     "subi r25, 0xff\n\t" /* forward; without carry where it wraps */
                     "out %[low], r25\n\t"
                     "brcs 4f\n\t"
                     "in r25, %[high]\n\t"
                     "inc r25\n\t"
                     "rjmp 2f\n"
                     "1:\n\t"
                     "subi r25, 1\n\t" /* backward; with carry where it wraps */
                     "out %[low], r25\n\t"
                     "brcc 4f\n\t"
                     "in r25, %[high]\n\t"
                     "dec r25\n"
                     "2:\n\t"
                     "out %[high], r25\n\t"
                     "rjmp 4f\n"
                     "3:\n\t"
                     "lds r24, %[errors]\n\t"
                     "lds r25, %[errors]+1\n\t"
                     "adiw r24, 1\n\t"
                     "sts %[errors]+1, r25\n\t"
                     "sts %[errors], r24\n"
                     "4:\n\t"
                     "pop r25\n\t"
                     "pop r24\n\t"
                     "out __SREG__, r24\n\t"
                     "pop r24\n\t"
                     "reti\n" ::[pins] "I"(_SFR_IO_ADDR(PIND)),
                     [seen] "I"(_SFR_IO_ADDR(SEEN)), [low] "I"(_SFR_IO_ADDR(COUNT_LOW)),
                     [high] "I"(_SFR_IO_ADDR(COUNT_HIGH)), [both] "M"(_BV(ENCODER_A) | _BV(ENCODER_B)),
                     [b] "I"(ENCODER_B), [errors] "i"(&errors));
}

_Static_assert(ENCODER_B == ENCODER_A + 1, "a shift brings A to where B is");
