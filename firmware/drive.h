/* What drives the motor: the state, who owns it, what sets the duty, and what takes it away. */
#ifndef DRIVE_H
#define DRIVE_H

#include <stdint.h>

#include "protocol.h"
#include "states.h"

/* Begins in switch_on_disabled, or in fault where the chip reset itself. */
void drive_init(uint8_t reset_cause);

/* What the main loop asks for; each returns one of the refusals. */
uint8_t drive_claim(uint16_t owner);
uint8_t drive_release(void);
uint8_t drive_configure(uint16_t watchdog_ms, uint16_t stall_duty);
uint8_t drive_gains(int32_t kp, int32_t ki, uint16_t limit);
uint8_t drive_enable(uint8_t mode);
uint8_t drive_actuate(int16_t duty);
uint8_t drive_extend_table(const table_message *chunk);
uint8_t drive_follow(int32_t reference);
uint8_t drive_set_position(int32_t position);
uint8_t drive_stop(void);
uint8_t drive_clear(void);

/* 1 while the samples set the duty, and so may not end. */
uint8_t drive_needs_samples(void);

uint8_t drive_state(void);
uint8_t drive_faults(void);
uint8_t drive_warnings(void);
uint16_t drive_owner(void);
uint16_t drive_watchdog_ms(void);
uint32_t drive_table_next(void);

/* What the tick calls. */
void drive_tick(int32_t position, int16_t change, uint16_t encoder_errors);
void drive_sample(int32_t position);
void drive_fault(uint8_t fault);
int16_t drive_duty(void);
void drive_output(int16_t *duty, uint16_t *age);

#endif
