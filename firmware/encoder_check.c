#include "encoder_check.h"

#include "protocol.h"

uint8_t encoder_check_tick(encoder_check *check, int16_t change, uint16_t errors) {
    check->motion += change < 0 ? (uint16_t)-change : (uint16_t)change;
    if (++check->elapsed < ENCODER_WINDOW_MS)
        return 0;
    uint16_t found = errors - check->errors_before;
    uint8_t wrong = found > ENCODER_LEAST_ERRORS && (uint32_t)found * ENCODER_EDGES_PER_ERROR > check->motion;
    check->elapsed = 0;
    check->motion = 0;
    check->errors_before = errors;
    return wrong;
}
