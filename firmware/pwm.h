/* The bridge: PWM by timer 1, direction, enable. */
#ifndef PWM_H
#define PWM_H

#include <stdint.h>

void pwm_init(void);

/* Switches the bridge on, at zero duty. */
void pwm_enable(void);

/* Takes the motor's voltage away and switches the bridge off. */
void pwm_off(void);

/* Puts out a duty between -DUTY_FULL and DUTY_FULL. Only with the bridge on; from
   the tick, or with the tick locked out. */
void pwm_set(int16_t duty);

#endif
