/* The serial port: rings of bytes, filled and emptied by interrupts. */
#ifndef SERIAL_H
#define SERIAL_H

#include <stdint.h>

#ifndef BAUD
#define BAUD 500000UL
#endif

void serial_init(void);

/* Returns the next byte received, or -1. */
int16_t serial_take(void);

uint8_t serial_is_empty(void);

/* Queues a frame; returns 0 where there is no room for all of it and that many bytes more. */
uint8_t serial_send(const uint8_t *frame, uint8_t length, uint8_t spare);

/* Bytes lost so far because nobody took them in time. */
uint16_t serial_lost(void);

#endif
