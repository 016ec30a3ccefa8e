/* The rig on simulated silicon: the firmware's binary in simavr, instruction by instruction, with a motor, an encoder and a
   current sensor around it. A shared library for tests in lock-step; with -DPROGRAM a program at a pseudo-terminal.

   Copyright 2026, the servobench authors.
   This test program is linked with simavr and so is free software under the GNU General Public License, version 3 or later
   (https://www.gnu.org/licenses/): it comes without any warranty. It is built where tests run and is no part of the package. */

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <simavr/avr_adc.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_cycle_timers.h>
#include <simavr/sim_elf.h>

#define FREQUENCY 16000000
#define INPUT_SIZE 65536
#define OUTPUT_SIZE (1 << 20)
#define SENSOR_CYCLES 1600 /* the current sensor's output is renewed every 100 us */

/* Data addresses of the registers that say what the bridge is told. */
enum { PORTB_AT = 0x25, DDRB_AT = 0x24, PORTD_AT = 0x2b, DDRD_AT = 0x2a, TCCR1A_AT = 0x80, OCR1A_AT = 0x88 };

typedef struct {
    double resistance, inductance, constant, inertia, damping, coulomb; /* SI */
    double supply;                                                     /* V */
    double counts_per_rev;
    double start; /* counts; the shaft's angle at the start */
    uint32_t step; /* cycles of a step of the motor, 4 at least; the encoder moves by an edge in each at most */
} motor_settings;

/* What a test may look at. */
typedef struct {
    uint64_t cycle;
    uint64_t pwm_high;  /* the last cycle in which the PWM pin was high while the bridge was on */
    uint64_t pwm_rises; /* how often it went high */
    uint64_t received;  /* the cycle in which the last byte from the host was handed to the UART */
    int64_t edges;      /* of the encoder, with their sign: its true count */
    double angle, speed, current, voltage; /* SI */
    double duty;                           /* what the registers put out, -1 to 1 */
    uint8_t pwm, enable, in1, in2;         /* the pins' levels */
    uint8_t crashed;
    uint8_t padding[3];
    uint32_t output_lost; /* bytes that nobody took */
} rig_view;

typedef struct {
    avr_t *avr;
    motor_settings motor;
    double transition[4], drive[4]; /* of (current, speed) in a step, by (current, speed) and by (voltage, torque) */
    double still;                   /* of the current alone */
    double angle, speed, current, voltage;
    int blocked, stuck; /* stuck: channels (1 A, 2 B) that keep their level */
    int64_t edges;
    uint64_t next_step, next_edge, next_sensor;
    double edge_period; /* cycles; 0: the motor moves the encoder */
    double edge_due;
    int64_t edges_left;
    uint64_t pwm_high, pwm_rises, received;
    uint8_t pwm;
    avr_irq_t *channel[2], *uart_in, *sensor;
    avr_ioport_t *port; /* D, with the encoder */
    uint8_t level[2];
    int room; /* the UART takes bytes */
    uint8_t input[INPUT_SIZE], output[OUTPUT_SIZE];
    uint32_t input_head, input_tail, output_head, output_tail, output_lost;
    int crashed;
} rig;

/* The motor: L di/dt = v - R i - k w, J dw/dt = k i - b w - T; solved exactly for a voltage and a torque that hold in a step. */
static void prepare_motor(rig *r) {
    const motor_settings *m = &r->motor;
    double h = (double)m->step / FREQUENCY;
    double a[4] = {-m->resistance / m->inductance, -m->constant / m->inductance, m->constant / m->inertia,
                   -m->damping / m->inertia};
    double term[4] = {1, 0, 0, 1}, sum[4] = {0, 0, 0, 0}, factor = h;
    for (int n = 1; n < 30; n++) { /* sum = integral of exp(a t) over the step */
        for (int i = 0; i < 4; i++)
            sum[i] += term[i] * factor;
        double next[4] = {term[0] * a[0] + term[1] * a[2], term[0] * a[1] + term[1] * a[3],
                          term[2] * a[0] + term[3] * a[2], term[2] * a[1] + term[3] * a[3]};
        memcpy(term, next, sizeof next);
        factor *= h / (n + 1);
    }
    r->transition[0] = 1 + a[0] * sum[0] + a[1] * sum[2];
    r->transition[1] = a[0] * sum[1] + a[1] * sum[3];
    r->transition[2] = a[2] * sum[0] + a[3] * sum[2];
    r->transition[3] = 1 + a[2] * sum[1] + a[3] * sum[3];
    r->drive[0] = sum[0] / m->inductance;
    r->drive[1] = sum[1] / m->inertia;
    r->drive[2] = sum[2] / m->inductance;
    r->drive[3] = sum[3] / m->inertia;
    r->still = exp(a[0] * h);
}

static double duty_of(rig *r) {
    const uint8_t *data = r->avr->data;
    int on = data[PORTB_AT] & data[DDRB_AT] & 0x04;
    int direction = (data[PORTB_AT] & data[DDRB_AT] & 0x01 ? 1 : 0) - (data[PORTD_AT] & data[DDRD_AT] & 0x80 ? 1 : 0);
    if (!on || !direction || !(data[DDRB_AT] & 0x02))
        return 0;
    if (data[TCCR1A_AT] & 0x80)
        return direction * ((data[OCR1A_AT] | data[OCR1A_AT + 1] << 8) + 1) / 1024.0;
    return data[PORTB_AT] & 0x02 ? direction : 0;
}

static int bridge_on(rig *r) {
    const uint8_t *data = r->avr->data;
    return (data[PORTB_AT] & data[DDRB_AT] & 0x04) &&
           ((data[PORTB_AT] & data[DDRB_AT] & 0x01) || (data[PORTD_AT] & data[DDRD_AT] & 0x80));
}

static void turn(rig *r) {
    const motor_settings *m = &r->motor;
    double h = (double)m->step / FREQUENCY;
    r->voltage = duty_of(r) * m->supply;
    if (!bridge_on(r)) { /* the bridge has let go: no current, the shaft coasts */
        r->current = 0;
        r->voltage = m->constant * r->speed;
    }
    double i = r->current, w = r->speed;
    if (r->blocked || (w == 0 && fabs(m->constant * i) <= m->coulomb)) {
        r->speed = 0;
        r->current = i * r->still + (1 - r->still) * r->voltage / m->resistance;
        return;
    }
    double torque = w > 0 || (w == 0 && i > 0) ? -m->coulomb : m->coulomb;
    r->current = r->transition[0] * i + r->transition[1] * w + r->drive[0] * r->voltage + r->drive[1] * torque;
    r->speed = r->transition[2] * i + r->transition[3] * w + r->drive[2] * r->voltage + r->drive[3] * torque;
    if (w * r->speed < 0 && fabs(m->constant * r->current) <= m->coulomb)
        r->speed = 0; /* friction holds it */
    if (!bridge_on(r))
        r->current = 0;
    r->angle += h * (w + r->speed) / 2;
}

/* Tells simavr the encoder's levels as what holds the pins from outside: whenever the firmware writes to PORTD simavr takes the
   inputs from there again. What AVR_IOCTL_IOPORT_SET_EXTERNAL does, without its search. */
static void hold_pins(rig *r) {
    r->port->external.pull_mask = 0x0c;
    r->port->external.pull_value = (uint8_t)(r->level[0] << 2 | r->level[1] << 3);
}

static void set_level(rig *r, int channel, uint8_t level) {
    if (level == r->level[channel])
        return;
    r->level[channel] = level;
    hold_pins(r);
    avr_raise_irq(r->channel[channel], level);
}

static void show_channels(rig *r) {
    static const uint8_t gray[4] = {0, 1, 3, 2}; /* bit 0 is A, bit 1 is B */
    for (int each = 0; each < 2; each++)
        if (!(r->stuck & 1 << each))
            set_level(r, each, gray[r->edges & 3] >> each & 1);
}

static void count(rig *r, int direction) {
    r->edges += direction;
    show_channels(r);
}

static void follow_shaft(rig *r) {
    int64_t there = (int64_t)floor(r->motor.start + r->angle * r->motor.counts_per_rev / (2 * M_PI));
    if (there != r->edges)
        count(r, there > r->edges ? 1 : -1);
}

/* What is due by now: edges at a fixed rate, a step of the motor, the sensor, a byte for the UART. */
static void attend(rig *r) {
    uint64_t now = r->avr->cycle;
    if (r->edge_period > 0 && now >= r->next_edge && r->edges_left) {
        int direction = r->edges_left > 0 ? 1 : -1;
        r->edges_left -= direction;
        r->edge_due += r->edge_period;
        r->next_edge = (uint64_t)r->edge_due;
        count(r, direction);
    }
    if (now >= r->next_step) {
        r->next_step += r->motor.step;
        turn(r);
        if (r->edge_period == 0)
            follow_shaft(r);
    }
    if (now >= r->next_sensor) {
        r->next_sensor += SENSOR_CYCLES;
        avr_raise_irq(r->sensor, (uint32_t)(2500 + 185 * r->current));
    }
    if (r->room && r->input_head != r->input_tail) {
        avr_raise_irq(r->uart_in, r->input[r->input_tail++ % INPUT_SIZE]);
        r->received = now;
    }
}

static void on_pwm(struct avr_irq_t *irq, uint32_t value, void *param) {
    rig *r = param;
    (void)irq;
    if ((value & 1) && !r->pwm)
        r->pwm_rises++;
    if (!(value & 1) && r->pwm && bridge_on(r))
        r->pwm_high = r->avr->cycle;
    r->pwm = value & 1;
}

static void on_byte(struct avr_irq_t *irq, uint32_t value, void *param) {
    rig *r = param;
    (void)irq;
    if (r->output_head - r->output_tail < OUTPUT_SIZE)
        r->output[r->output_head++ % OUTPUT_SIZE] = (uint8_t)value;
    else
        r->output_lost++;
}

static void on_room(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    (void)value;
    ((rig *)param)->room = 1;
}

static void on_full(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    if (value)
        ((rig *)param)->room = 0;
}

static void quiet(avr_t *avr, const int level, const char *format, va_list arguments) {
    if (level <= 1)
        vfprintf(stderr, format, arguments);
    (void)avr;
}

/* A chip that sleeps is woken this often at the least: simavr lets it sleep until the next of these timers is due. */
static avr_cycle_count_t pace(struct avr_t *avr, avr_cycle_count_t when, void *param) {
    (void)avr;
    return when + ((rig *)param)->motor.step / 4;
}

/* simavr itself waits in here, for as long as the chip sleeps; device time has nothing to do with ours. */
static void sleep_at_once(avr_t *avr, avr_cycle_count_t cycles) {
    (void)avr;
    (void)cycles;
}

/* The pins between the encoder and the chip, what the UART is told, and the pace; again after a reset of the chip. */
static void wire(rig *r) {
    hold_pins(r);
    avr_cycle_timer_register(r->avr, r->motor.step / 4, pace, r);
    uint32_t flags = 0;
    avr_ioctl(r->avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(uint32_t)(AVR_UART_FLAG_POOL_SLEEP | AVR_UART_FLAG_STDIO);
    avr_ioctl(r->avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    for (int each = 0; each < 2; each++)
        avr_raise_irq(r->channel[each], r->level[each]);
}

rig *rig_new(const char *elf, const motor_settings *motor) {
    elf_firmware_t firmware;
    memset(&firmware, 0, sizeof firmware);
    avr_global_logger_set(quiet);
    if (elf_read_firmware(elf, &firmware))
        return NULL;
    rig *r = calloc(1, sizeof *r);
    r->motor = *motor;
    prepare_motor(r);
    r->avr = avr_make_mcu_by_name("atmega328p");
    firmware.frequency = FREQUENCY;
    avr_init(r->avr);
    avr_load_firmware(r->avr, &firmware);
    r->avr->frequency = FREQUENCY;
    r->avr->vcc = r->avr->avcc = r->avr->aref = 5000;
    r->avr->sleep = sleep_at_once;
    /* The pins are interrupts of their own, too, which the firmware leaves off; simavr looks at a low one in every cycle. */
    for (uint8_t each = 0; each < 2; each++)
        avr_extint_set_strict_lvl_trig(r->avr, each, 0);
    r->avr->run_cycle_limit = motor->step / 4; /* how long the chip runs before the world around it is attended to */
    for (avr_io_t *io = r->avr->io_port; io; io = io->next)
        if (!strcmp(io->kind, "port") && ((avr_ioport_t *)io)->name == 'D')
            r->port = (avr_ioport_t *)io;
    r->channel[0] = avr_io_getirq(r->avr, AVR_IOCTL_IOPORT_GETIRQ('D'), 2);
    r->channel[1] = avr_io_getirq(r->avr, AVR_IOCTL_IOPORT_GETIRQ('D'), 3);
    r->uart_in = avr_io_getirq(r->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    r->sensor = avr_io_getirq(r->avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0);
    avr_irq_register_notify(avr_io_getirq(r->avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 1), on_pwm, r);
    avr_irq_register_notify(avr_io_getirq(r->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_byte, r);
    avr_irq_register_notify(avr_io_getirq(r->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON), on_room, r);
    avr_irq_register_notify(avr_io_getirq(r->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF), on_full, r);
    r->edges = (int64_t)floor(r->motor.start);
    r->level[0] = r->level[1] = 0xff; /* unlike any level */
    show_channels(r);
    wire(r);
    avr_raise_irq(r->sensor, 2500);
    return r;
}

void rig_free(rig *r) {
    avr_terminate(r->avr);
    free(r);
}

/* Lets that many cycles pass. */
void rig_run(rig *r, uint64_t cycles) {
    uint64_t end = r->avr->cycle + cycles;
    while (r->avr->cycle < end && !r->crashed) {
        int state = avr_run(r->avr);
        attend(r);
        r->crashed = state == cpu_Done || state == cpu_Crashed;
    }
}

/* Lets cycles pass until a zero byte, which ends a frame, was sent, but no more than that many. */
void rig_run_to_frame(rig *r, uint64_t cycles) {
    uint64_t end = r->avr->cycle + cycles;
    while (r->avr->cycle < end && !r->crashed) {
        uint32_t before = r->output_head;
        int state = avr_run(r->avr);
        attend(r);
        r->crashed = state == cpu_Done || state == cpu_Crashed;
        if (r->output_head != before && r->output[before % OUTPUT_SIZE] == 0)
            return;
    }
}

int rig_write(rig *r, const uint8_t *bytes, int count) {
    int taken = 0;
    while (taken < count && r->input_head - r->input_tail < INPUT_SIZE)
        r->input[r->input_head++ % INPUT_SIZE] = bytes[taken++];
    return taken;
}

int rig_unsent(rig *r) { return (int)(r->input_head - r->input_tail); }

int rig_read(rig *r, uint8_t *bytes, int most) {
    int count = 0;
    while (count < most && r->output_tail != r->output_head)
        bytes[count++] = r->output[r->output_tail++ % OUTPUT_SIZE];
    return count;
}

void rig_look(rig *r, rig_view *view) {
    const uint8_t *data = r->avr->data;
    memset(view, 0, sizeof *view);
    view->cycle = r->avr->cycle;
    view->pwm_high = r->pwm && bridge_on(r) ? r->avr->cycle : r->pwm_high;
    view->pwm_rises = r->pwm_rises;
    view->received = r->received;
    view->edges = r->edges;
    view->angle = r->angle;
    view->speed = r->speed;
    view->current = r->current;
    view->voltage = r->voltage;
    view->duty = duty_of(r);
    view->pwm = r->pwm;
    view->enable = (data[PORTB_AT] & data[DDRB_AT] & 0x04) != 0;
    view->in1 = (data[PORTB_AT] & data[DDRB_AT] & 0x01) != 0;
    view->in2 = (data[PORTD_AT] & data[DDRD_AT] & 0x80) != 0;
    view->crashed = (uint8_t)r->crashed;
    view->output_lost = r->output_lost;
}

/* Moves the encoder by itself: `edges` (their sign is the direction) at `rate` per second; rate 0: the motor moves it again. */
void rig_move_encoder(rig *r, double rate, int64_t edges) {
    r->edge_period = rate > 0 ? FREQUENCY / rate : 0;
    r->edges_left = edges;
    r->edge_due = (double)r->avr->cycle + r->edge_period;
    r->next_edge = (uint64_t)r->edge_due;
    if (rate == 0)
        r->motor.start = (double)r->edges + 0.5 - r->angle * r->motor.counts_per_rev / (2 * M_PI);
}

int64_t rig_edges_left(rig *r) { return r->edges_left; }

void rig_block(rig *r, int blocked) { r->blocked = blocked; }

void rig_stick(rig *r, int channels) {
    r->stuck = channels;
    show_channels(r);
}

/* Turns both channels over at once: a transition that no encoder makes. */
void rig_disturb(rig *r) {
    for (int each = 0; each < 2; each++)
        set_level(r, each, !r->level[each]);
}

/* Presses the reset button. */
void rig_reset(rig *r) {
    avr_reset(r->avr);
    wire(r);
}

#ifdef PROGRAM

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <sched.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#define SLICE (FREQUENCY / 2000) /* cycles; bytes are exchanged with the terminal after each */
/* A quartz doesn't stand still while the computer does: time that was lost is made up for at this many times real time, so that a
   host has time to answer. A machine too slow for that falls behind by so many seconds, and from there on the rig is slow, too. */
#define HASTE 2.0
#define MOST_BEHIND 1.0

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int open_terminal(void) {
    int master, slave;
    char name[128];
    struct termios raw;
    if (openpty(&master, &slave, name, NULL, NULL)) {
        perror("openpty");
        exit(1);
    }
    tcgetattr(slave, &raw);
    cfmakeraw(&raw);
    tcsetattr(slave, TCSANOW, &raw);
    close(slave); /* so that the end of the host is seen */
    fcntl(master, F_SETFL, O_NONBLOCK);
    printf("%s\n", name);
    fflush(stdout);
    return master;
}

/* Returns 1 while a host has the terminal open. */
static int exchange(rig *r, int master) {
    uint8_t bytes[4096];
    struct pollfd look = {.fd = master, .events = POLLIN};
    poll(&look, 1, 0);
    int open = !(look.revents & POLLHUP);
    if (look.revents & POLLIN) {
        ssize_t count = read(master, bytes, sizeof bytes);
        if (count > 0)
            rig_write(r, bytes, (int)count);
    }
    int count = rig_read(r, bytes, sizeof bytes);
    if (open && count) /* what a host doesn't take is lost, as on a wire */
        if (write(master, bytes, (size_t)count) < 0 && errno != EAGAIN && errno != EIO)
            perror("write");
    return open;
}

static void report(rig *r) {
    rig_view v;
    rig_look(r, &v);
    printf("{\"cycle\": %llu, \"pwm_high\": %llu, \"received\": %llu, \"speed\": %.9g, \"duty\": %.9g, \"enable\": %d}\n",
           (unsigned long long)v.cycle, (unsigned long long)v.pwm_high, (unsigned long long)v.received, v.speed, v.duty,
           v.enable);
    fflush(stdout);
}

/* Lines on standard input: "look" prints the view, "block 0|1" holds the shaft; its end ends the program. */
static int obey(rig *r) {
    static char line[64];
    static size_t length;
    struct pollfd look = {.fd = 0, .events = POLLIN};
    while (poll(&look, 1, 0) > 0) {
        char byte;
        if (read(0, &byte, 1) <= 0)
            return 0;
        if (byte != '\n') {
            if (length < sizeof line - 1)
                line[length++] = byte;
            continue;
        }
        line[length] = 0;
        length = 0;
        if (!strcmp(line, "look"))
            report(r);
        if (!strncmp(line, "block ", 6))
            rig_block(r, atoi(line + 6));
    }
    return 1;
}

static void set(motor_settings *m, const char *word) {
    const char *names[] = {"resistance", "inductance", "constant", "inertia", "damping", "coulomb", "supply", "counts_per_rev",
                           "start"};
    double *values[] = {&m->resistance, &m->inductance, &m->constant, &m->inertia, &m->damping, &m->coulomb, &m->supply,
                        &m->counts_per_rev, &m->start};
    const char *equals = strchr(word, '=');
    for (size_t i = 0; equals && i < sizeof names / sizeof names[0]; i++)
        if (!strncmp(names[i], word, (size_t)(equals - word)) && !names[i][equals - word]) {
            *values[i] = atof(equals + 1);
            return;
        }
    fprintf(stderr, "%s: expected NAME=VALUE with a name of the motor\n", word);
    exit(2);
}

int main(int count, char **words) {
    motor_settings motor = {8.4, 1.16e-3, 0.042, 2.0952e-5, 1e-6, 8e-4, 12, 2048, 0.5, 80};
    if (count < 2) {
        fprintf(stderr, "usage: %s FIRMWARE.elf [NAME=VALUE ...]\n", words[0]);
        return 2;
    }
    for (int i = 2; i < count; i++)
        set(&motor, words[i]);
    rig *r = rig_new(words[1], &motor);
    if (!r)
        return 1;
    /* Where it is allowed to it keeps up with real time on a busy machine, too. */
    struct sched_param priority = {.sched_priority = 10};
    sched_setscheduler(0, SCHED_FIFO, &priority);
    int master = open_terminal();
    double begun = now();
    while (obey(r) && !r->crashed) {
        double before = now();
        rig_run(r, SLICE);
        exchange(r, master);
        double due = begun + (double)r->avr->cycle / FREQUENCY;
        double ahead = fmax(due, before + SLICE / (HASTE * FREQUENCY)) - now();
        if (ahead > 0)
            usleep((useconds_t)(1e6 * ahead));
        begun += fmax(0, now() - due - MOST_BEHIND);
    }
    return r->crashed;
}

#endif
