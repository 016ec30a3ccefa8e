#include "sampling.h"

#include <avr/interrupt.h>
#include <util/atomic.h>

#include "drive.h"
#include "extend.h"
#include "pins.h"
#include "quadrature.h"

#define RING 16 /* a power of two; two blocks */
#define STEPS 250 /* of timer 2 in a tick: 16 MHz / 64 / 250 = 1 kHz */

static sample ring[RING];
static volatile uint8_t head, tail; /* samples begun, and taken; both wrap */
static volatile uint8_t converted;  /* samples whose current is there, too */
static volatile uint32_t ticks;
static volatile uint8_t locked, due; /* a tick is under way or has to wait; one waits */
static volatile int32_t position;
static uint16_t counter_before;
static uint8_t period, left;
static volatile uint16_t lost;

void sampling_init(void) {
    ADMUX = _BV(REFS0) | CURRENT_CHANNEL;                                   /* against the supply of 5 V */
    ADCSRA = _BV(ADEN) | _BV(ADIE) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0); /* 104 us */
    DIDR0 = _BV(ADC0D);
    counter_before = quadrature_count();
    TCCR2A = _BV(WGM21);
    TCCR2B = _BV(CS22);
    OCR2A = STEPS - 1;
    TIMSK2 = _BV(OCIE2A);
}

void sampling_start(uint8_t new_period) {
    sampling_lock();
    period = new_period;
    left = 1;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { tail = converted = head; } /* a conversion under way finds nothing to complete */
    sampling_unlock();
}

uint8_t sampling_period(void) { return period; }

uint8_t sampling_waiting(void) { return (uint8_t)(converted - tail); }

const sample *sampling_oldest(void) { return converted == tail ? 0 : &ring[tail & (RING - 1)]; }

void sampling_drop(void) { tail++; }

uint8_t sampling_events(void) { return (uint8_t)((uint8_t)ticks + converted); }

uint32_t sampling_time(void) {
    uint32_t found;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { found = ticks; }
    return found;
}

int32_t sampling_position(void) {
    int32_t found;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { found = position; }
    return found;
}

void sampling_set_position(int32_t new_position) {
    sampling_lock();
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { counter_before = quadrature_count(); }
    position = new_position;
    sampling_unlock();
}

uint16_t sampling_lost(void) {
    uint16_t found;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { found = lost; }
    return found;
}

uint32_t sampling_now(void) {
    uint8_t step = TCNT2;
    /* A tick that has come and isn't served yet isn't in `ticks`. */
    uint8_t pending = due || ((TIFR2 & _BV(OCF2A)) && step < STEPS / 2);
    return (ticks + pending) * STEPS + step;
}

static void begin_sample(void) {
    if ((uint8_t)(head - tail) >= RING) {
        lost++;
        return;
    }
    sample *next = &ring[head & (RING - 1)];
    next->time = ticks;
    next->position = position;
    drive_output(&next->duty, &next->age);
    drive_sample(position);
    next->after = drive_duty();
    head++;
}

static void tick(void) {
    static uint16_t lost_before;
    uint16_t counter, errors, lost_now;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        counter = quadrature_count();
        errors = quadrature_errors();
    }
    uint8_t sampled = period && --left == 0;
    if (sampled) {
        ADCSRA |= _BV(ADSC);
        left = period;
    }
    int16_t change = counter_change(counter, counter_before);
    counter_before = counter;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        lost_now = lost;
        ticks++;
        position = position_after(position, change);
    }
    if (sampled)
        begin_sample();
    drive_tick(position, change, errors);
    if (lost_now != lost_before) {
        lost_before = lost_now;
        drive_fault(FAULT_OVERLOAD);
    }
}

/* Other interrupts may come in between: an encoder edge can't wait for a whole tick. */
ISR(TIMER2_COMPA_vect, ISR_NOBLOCK) {
    if (locked) {
        lost += due;
        due = 1;
        return;
    }
    locked = 1;
    tick();
    sampling_unlock();
}

void sampling_lock(void) { locked = 1; }

void sampling_unlock(void) {
    for (;;) {
        cli();
        if (!due)
            break;
        due = 0;
        sei();
        tick();
    }
    locked = 0;
    sei();
}

ISR(ADC_vect) {
    uint8_t done = converted;
    if (done != head) {
        ring[done & (RING - 1)].current = ADC;
        converted = done + 1;
    }
}
