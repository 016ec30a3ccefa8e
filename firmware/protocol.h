/* Written by tools/write_rig_protocol.py from protocol.toml: change that, then run `make generate`. */
#ifndef PROTOCOL_H
#define PROTOCOL_H

#include <stdint.h>

#define SCHEMA_HASH 0x9ff026c5UL

#define TICK_US 1000
#define DUTY_FULL 1024
#define BLOCK_SAMPLES 8
#define TABLE_CHUNK 8
#define TABLE_SIZE 128
#define WATCHDOG_DEFAULT_MS 50
#define WATCHDOG_MIN_MS 20
#define WATCHDOG_MAX_MS 500
#define STALL_WARNING_MS 80
#define STALL_CUT_MS 3000
#define STALL_COUNTS 2
#define STALL_DUTY_DEFAULT 410
#define ENCODER_WINDOW_MS 100
#define ENCODER_LEAST_ERRORS 4
#define ENCODER_EDGES_PER_ERROR 1000

#define STATE_NOT_READY 0
#define STATE_SWITCH_ON_DISABLED 1
#define STATE_READY 2
#define STATE_OPERATION_ENABLED 3
#define STATE_FAULT 4

#define FAULT_WATCHDOG 1
#define FAULT_STALL 2
#define FAULT_ENCODER 4
#define FAULT_TABLE_EMPTY 8
#define FAULT_OVERLOAD 16
#define FAULT_HARDWARE_WATCHDOG 32
#define FAULT_BROWN_OUT 64

#define WARNING_STALL 1

#define RESET_POWER_ON 1
#define RESET_EXTERNAL 2
#define RESET_BROWN_OUT 4
#define RESET_WATCHDOG 8

#define REFUSED_NONE 0
#define REFUSED_SCHEMA 1
#define REFUSED_OWNER 2
#define REFUSED_STATE 3
#define REFUSED_VALUE 4
#define REFUSED_UNKNOWN 5
#define REFUSED_GAP 6
#define REFUSED_DAMAGED 7

#define MODE_DIRECT 0
#define MODE_TABLE 1
#define MODE_POSITION 2
#define MODE_SPEED 3

#define MESSAGE_HELLO 0x01
#define MESSAGE_CLAIM 0x02
#define MESSAGE_CONFIGURE 0x03
#define MESSAGE_GAINS 0x04
#define MESSAGE_SAMPLING 0x05
#define MESSAGE_ENABLE 0x06
#define MESSAGE_DUTY 0x07
#define MESSAGE_TABLE 0x08
#define MESSAGE_REFERENCE 0x09
#define MESSAGE_STOP 0x0a
#define MESSAGE_CLEAR 0x0b
#define MESSAGE_RELEASE 0x0c
#define MESSAGE_SET_POSITION 0x0d
#define MESSAGE_INFO 0x80
#define MESSAGE_SAMPLE 0x81
#define MESSAGE_BLOCK 0x82
#define MESSAGE_STATUS 0x83

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
    uint32_t schema;
} hello_message;

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
    uint32_t schema;
    uint16_t owner;
} claim_message;

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
    uint16_t owner;
    uint16_t watchdog_ms;
    uint16_t stall_duty;
    uint16_t check;
} configure_message;

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
    uint16_t owner;
    int32_t kp;
    int32_t ki;
    uint16_t limit;
    uint16_t check;
} gains_message;

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
    uint16_t owner;
    uint8_t period;
    uint8_t block;
    uint16_t check;
} sampling_message;

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
    uint16_t owner;
    uint8_t mode;
    uint16_t check;
} enable_message;

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
    uint16_t owner;
    int16_t duty;
    uint16_t check;
} duty_message;

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
    uint16_t owner;
    uint32_t first;
    uint8_t count;
    uint8_t last;
    int16_t duty[8];
    uint16_t check;
} table_message;

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
    uint16_t owner;
    int32_t reference;
    uint16_t check;
} reference_message;

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
} stop_message;

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
} clear_message;

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
    uint16_t owner;
    uint16_t check;
} release_message;

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
    uint16_t owner;
    int32_t position;
    uint16_t check;
} set_position_message;

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
    uint32_t schema;
    uint16_t firmware;
    uint32_t baud;
    uint8_t reset_cause;
    uint8_t boots;
} info_message;

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
    uint32_t index;
    uint32_t time;
    int32_t position;
    int16_t duty;
    uint16_t age;
    uint16_t current;
    uint8_t state;
    uint8_t faults;
} sample_message;

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
    uint32_t index;
    uint32_t time;
    int32_t position;
    int16_t delta[7];
    int16_t duty[8];
    uint16_t current[8];
    uint32_t table_next;
    uint8_t state;
    uint8_t faults;
} block_message;

typedef struct __attribute__((packed)) {
    uint8_t code;
    uint8_t sequence;
    uint8_t ack;
    uint8_t command;
    uint8_t refusal;
    uint8_t state;
    uint8_t faults;
    uint8_t warnings;
    uint8_t reset_cause;
    uint16_t owner;
    uint16_t watchdog_ms;
    uint32_t time;
    int32_t position;
    uint32_t table_next;
    uint16_t crc_bad;
    uint16_t received_gaps;
    uint16_t refused;
    uint16_t rx_lost;
    uint16_t tx_lost;
    uint16_t encoder_errors;
    uint16_t ticks_lost;
} status_message;

#endif
