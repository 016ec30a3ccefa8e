#include "control.h"

#include "protocol.h"

#define ERROR_MAX 8388607L /* with gains up to 2^24 a product stays within 2^47, and times 2^8 within 2^55 */
#define KI_BITS 24         /* ki counts duties / 2^24, kp duties / 2^16 */
#define KP_SHIFT 8

static int64_t within(int64_t value, int64_t limit) {
    return value > limit ? limit : value < -limit ? -limit : value;
}

void control_start(pi_law *law, int32_t position) {
    law->sum = 0;
    law->reference = 0;
    law->place = 0;
    for (uint8_t i = 0; i < SPEED_TICKS; i++)
        law->before[i] = position;
}

void control_tick(pi_law *law, int32_t position) {
    law->before[law->place] = position;
    law->place = (law->place + 1) % SPEED_TICKS;
}

int16_t control_sample(pi_law *law, int32_t position, uint8_t speed) {
    int32_t moved = (int32_t)((uint32_t)position - (uint32_t)law->before[law->place]);
    int64_t limit = (int64_t)law->limit << KI_BITS;
    int64_t measured = speed ? (int64_t)moved * (1000000L / TICK_US / SPEED_TICKS) : position;
    int64_t error = within(law->reference - measured, ERROR_MAX);
    int64_t sum = within(law->sum + law->ki * error, limit);
    int64_t duty = law->kp * error * (1 << KP_SHIFT) + sum;
    int64_t limited = within(duty, limit);
    if (duty == limited || (duty > limited) != (error > 0))
        law->sum = sum;
    return (int16_t)(limited >> KI_BITS);
}
