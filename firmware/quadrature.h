/* The encoder, counted by pin-change interrupts. */
#ifndef QUADRATURE_H
#define QUADRATURE_H

#include <stdint.h>

void quadrature_init(void);

/* The counter, which wraps, and the number of illegal transitions, which wraps. Call with interrupts off. */
uint16_t quadrature_count(void);
uint16_t quadrature_errors(void);

#endif
