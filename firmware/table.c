#include "table.h"

void table_empty(signal_table *table) {
    table->next = 0;
    table->held = 0;
    table->ended = 0;
}

uint8_t table_extend(signal_table *table, const table_message *chunk) {
    if (chunk->first != table->next)
        return REFUSED_GAP;
    if (chunk->count > TABLE_CHUNK || chunk->count > TABLE_SIZE - table->held || (table->ended && chunk->count))
        return REFUSED_VALUE;
    for (uint8_t i = 0; i < chunk->count; i++)
        if (chunk->duty[i] > DUTY_FULL || chunk->duty[i] < -DUTY_FULL)
            return REFUSED_VALUE;
    for (uint8_t i = 0; i < chunk->count; i++)
        table->duty[(uint8_t)(table->next + i) & (TABLE_SIZE - 1)] = chunk->duty[i];
    table->next += chunk->count;
    table->held += chunk->count;
    table->ended |= chunk->last;
    return REFUSED_NONE;
}

uint8_t table_take(signal_table *table, int16_t *duty) {
    if (!table->held) {
        *duty = 0;
        return table->ended;
    }
    *duty = table->duty[(uint8_t)(table->next - table->held) & (TABLE_SIZE - 1)];
    table->held--;
    return 1;
}
