#include "stall.h"

#include "protocol.h"

uint16_t stall_tick(stall_monitor *monitor, int32_t position, int16_t duty) {
    /* Unsigned: the difference is right across the wrap of the position, too. */
    uint32_t moved = (uint32_t)position - (uint32_t)monitor->anchor + STALL_COUNTS;
    uint16_t size = duty < 0 ? (uint16_t)-duty : (uint16_t)duty;
    if (moved > 2 * STALL_COUNTS) {
        monitor->anchor = position;
        monitor->still = 0;
    } else if (size <= monitor->threshold) {
        monitor->still = 0;
    } else if (monitor->still < UINT16_MAX) {
        monitor->still++;
    }
    return monitor->still;
}
