#include "drive.h"

#include <avr/interrupt.h>

#include "control.h"
#include "encoder_check.h"
#include "pwm.h"
#include "sampling.h"
#include "stall.h"
#include "table.h"
#include "watchdog.h"

#define GAIN_MAX (1L << 24)
#define AGE_MAX 65535U

static volatile uint8_t state = STATE_NOT_READY, faults, warnings;
static uint16_t owner;
static uint8_t mode;
static int16_t duty;
static uint32_t changed; /* when the duty last changed [4 us] */
static host_watchdog watchdog = {WATCHDOG_DEFAULT_MS, 0};
static stall_monitor stall = {STALL_DUTY_DEFAULT, 0, 0};
static encoder_check encoder;
static signal_table table;
static pi_law law = {.limit = DUTY_FULL};

static void put(int16_t value) {
    if (value == duty)
        return;
    pwm_set(value);
    duty = value;
    changed = sampling_now();
}

/* Takes a transition. The bridge is on in operation_enabled and nowhere else. */
static uint8_t take(drive_event event) {
    uint8_t next = next_state(state, event);
    if (next == NO_TRANSITION)
        return REFUSED_STATE;
    if (next != STATE_OPERATION_ENABLED) {
        put(0);
        pwm_off();
        watchdog_rest(&watchdog);
        table_empty(&table);
    } else if (state != STATE_OPERATION_ENABLED) {
        pwm_enable();
    }
    state = next;
    return REFUSED_NONE;
}

void drive_init(uint8_t reset_cause) {
    pwm_init();
    if (reset_cause & RESET_WATCHDOG)
        drive_fault(FAULT_HARDWARE_WATCHDOG);
    else if ((reset_cause & RESET_BROWN_OUT) && !(reset_cause & RESET_POWER_ON))
        drive_fault(FAULT_BROWN_OUT);
    else
        take(EVENT_INITIALISED);
}

uint8_t drive_claim(uint16_t new_owner) {
    if (!new_owner)
        return REFUSED_VALUE;
    sampling_lock();
    uint8_t refusal = take(EVENT_CLAIM);
    if (refusal == REFUSED_NONE)
        owner = new_owner;
    sampling_unlock();
    return refusal;
}

uint8_t drive_release(void) {
    sampling_lock();
    uint8_t refusal = take(EVENT_RELEASE);
    if (refusal == REFUSED_NONE)
        owner = 0;
    sampling_unlock();
    return refusal;
}

uint8_t drive_configure(uint16_t watchdog_ms, uint16_t stall_duty) {
    if (watchdog_ms < WATCHDOG_MIN_MS || watchdog_ms > WATCHDOG_MAX_MS || !stall_duty || stall_duty > DUTY_FULL)
        return REFUSED_VALUE;
    if (state != STATE_READY)
        return REFUSED_STATE;
    sampling_lock();
    watchdog.timeout = watchdog_ms;
    stall.threshold = stall_duty;
    sampling_unlock();
    return REFUSED_NONE;
}

uint8_t drive_gains(int32_t kp, int32_t ki, uint16_t limit) {
    if (kp < 0 || kp > GAIN_MAX || ki < 0 || ki > GAIN_MAX || !limit || limit > DUTY_FULL)
        return REFUSED_VALUE;
    if (state != STATE_READY)
        return REFUSED_STATE;
    law.kp = kp;
    law.ki = ki;
    law.limit = (int16_t)limit;
    return REFUSED_NONE;
}

uint8_t drive_enable(uint8_t new_mode) {
    if (new_mode > MODE_SPEED)
        return REFUSED_VALUE;
    int32_t position = sampling_position();
    sampling_lock();
    uint8_t refusal = take(EVENT_ENABLE);
    if (refusal == REFUSED_NONE) {
        mode = new_mode;
        stall.still = 0;
        control_start(&law, position);
        if (mode == MODE_POSITION)
            law.reference = position;
    }
    sampling_unlock();
    return refusal;
}

uint8_t drive_actuate(int16_t value) {
    if (value > DUTY_FULL || value < -DUTY_FULL)
        return REFUSED_VALUE;
    uint8_t refusal = REFUSED_STATE;
    sampling_lock();
    if (state == STATE_OPERATION_ENABLED) {
        mode = MODE_DIRECT;
        put(value);
        watchdog_feed(&watchdog);
        refusal = REFUSED_NONE;
    }
    sampling_unlock();
    return refusal;
}

uint8_t drive_extend_table(const table_message *chunk) {
    uint8_t refusal = REFUSED_STATE;
    sampling_lock();
    if (state == STATE_OPERATION_ENABLED && mode == MODE_TABLE) {
        refusal = table_extend(&table, chunk);
        /* Until the first sample nothing is put out, and nothing is watched. */
        if (refusal == REFUSED_NONE && watchdog.left)
            watchdog_feed(&watchdog);
    }
    sampling_unlock();
    return refusal;
}

uint8_t drive_follow(int32_t reference) {
    uint8_t refusal = REFUSED_STATE;
    sampling_lock();
    if (state == STATE_OPERATION_ENABLED && (mode == MODE_POSITION || mode == MODE_SPEED)) {
        law.reference = reference;
        watchdog_feed(&watchdog);
        refusal = REFUSED_NONE;
    }
    sampling_unlock();
    return refusal;
}

uint8_t drive_set_position(int32_t position) {
    if (state != STATE_READY)
        return REFUSED_STATE;
    sampling_set_position(position);
    return REFUSED_NONE;
}

uint8_t drive_stop(void) {
    sampling_lock();
    uint8_t refusal = take(EVENT_STOP);
    sampling_unlock();
    return refusal;
}

uint8_t drive_clear(void) {
    sampling_lock();
    uint8_t refusal = take(EVENT_CLEAR);
    if (refusal == REFUSED_NONE) {
        faults = 0;
        owner = 0;
    }
    sampling_unlock();
    return refusal;
}

uint8_t drive_needs_samples(void) { return state == STATE_OPERATION_ENABLED && mode != MODE_DIRECT; }

uint8_t drive_state(void) { return state; }

uint8_t drive_faults(void) { return faults; }

uint8_t drive_warnings(void) { return warnings; }

uint16_t drive_owner(void) { return owner; }

uint16_t drive_watchdog_ms(void) { return watchdog.timeout; }

uint32_t drive_table_next(void) {
    sampling_lock();
    uint32_t found = table.next;
    sampling_unlock();
    return found;
}

void drive_fault(uint8_t fault) {
    faults |= fault;
    take(EVENT_FAULT);
}

static void watch_stall(int32_t position) {
    uint16_t still = stall_tick(&stall, position, duty);
    warnings = still >= STALL_WARNING_MS ? WARNING_STALL : 0;
    if (still >= STALL_CUT_MS)
        drive_fault(FAULT_STALL);
}

void drive_tick(int32_t position, int16_t change, uint16_t encoder_errors) {
    uint8_t errors_at_rate = encoder_check_tick(&encoder, change, encoder_errors);
    if (state != STATE_OPERATION_ENABLED) {
        warnings = 0;
        return;
    }
    if (watchdog_tick(&watchdog)) {
        drive_fault(FAULT_WATCHDOG);
        return;
    }
    if (errors_at_rate) {
        drive_fault(FAULT_ENCODER);
        return;
    }
    control_tick(&law, position);
    watch_stall(position);
}

/* In all modes but the direct one: the duty of this sample. */
void drive_sample(int32_t position) {
    if (!drive_needs_samples())
        return;
    if (mode != MODE_TABLE) {
        if (watchdog.left)
            put(control_sample(&law, position, mode == MODE_SPEED));
        return;
    }
    int16_t value;
    if (!table_take(&table, &value)) {
        drive_fault(FAULT_TABLE_EMPTY);
        return;
    }
    if (!watchdog.left)
        watchdog_feed(&watchdog);
    put(value);
}

int16_t drive_duty(void) { return duty; }

void drive_output(int16_t *value, uint16_t *age) {
    uint32_t since = sampling_now() - changed;
    *value = duty;
    *age = since > AGE_MAX ? AGE_MAX : (uint16_t)since;
}
