/* The signal table: duties that the host sends in advance. No registers: also compiled for tests. */
#ifndef TABLE_H
#define TABLE_H

#include <stdint.h>

#include "protocol.h"

#if TABLE_SIZE & (TABLE_SIZE - 1)
#error "the table's size has to be a power of two"
#endif

typedef struct {
    int16_t duty[TABLE_SIZE];
    uint32_t next; /* index of the duty that comes after the last one held */
    uint8_t held;  /* how many are held */
    uint8_t ended; /* the last one has come */
} signal_table;

void table_empty(signal_table *table);

/* Goes on with a chunk; returns one of the refusals. */
uint8_t table_extend(signal_table *table, const table_message *chunk);

/* Takes the next duty; returns 0 where none was left although the table hasn't ended. After its end the duty is 0. */
uint8_t table_take(signal_table *table, int16_t *duty);

#endif
