#include "link.h"

#include <string.h>
#include <util/atomic.h>

#include "drive.h"
#include "frames.h"
#include "quadrature.h"
#include "reset.h"
#include "sampling.h"
#include "serial.h"

#define FIRMWARE_VERSION 1
#define CHECKSUM 2
/* What samples leave free, so that a port that is too slow for them still brings the answers: INFO and STATUS as frames. */
#define ANSWERS (sizeof(info_message) + sizeof(status_message) + 2 * (CHECKSUM + 2))

static frame_reader reader;
static uint8_t sequence, received_sequence = 0xff, first_boot = 1, blocks;
static uint16_t crc_bad, received_gaps, refused, tx_lost;
static uint32_t index;
static uint8_t told_state = 0xff, told_faults, told_warnings;

static void send(uint8_t *payload, uint8_t length, uint8_t spare) {
    static uint8_t frame[SEND_MAX];
    payload[1] = sequence++;
    if (!serial_send(frame, frame_encode(payload, length, frame), spare))
        tx_lost++;
}

static void send_status(uint8_t command, uint8_t refusal) {
    union {
        status_message message;
        uint8_t payload[sizeof(status_message) + CHECKSUM];
    } out;
    status_message *status = &out.message;
    status->code = MESSAGE_STATUS;
    status->ack = received_sequence;
    status->command = command;
    status->refusal = refusal;
    status->state = told_state = drive_state();
    status->faults = told_faults = drive_faults();
    status->warnings = told_warnings = drive_warnings();
    status->reset_cause = reset_cause();
    status->owner = drive_owner();
    status->watchdog_ms = drive_watchdog_ms();
    status->time = sampling_time();
    status->position = sampling_position();
    status->table_next = drive_table_next();
    status->crc_bad = crc_bad;
    status->received_gaps = received_gaps;
    status->refused = refused;
    status->rx_lost = serial_lost();
    status->tx_lost = tx_lost;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { status->encoder_errors = quadrature_errors(); }
    status->ticks_lost = sampling_lost();
    send(out.payload, sizeof(status_message), 0);
}

static void send_info(void) {
    union {
        info_message message;
        uint8_t payload[sizeof(info_message) + CHECKSUM];
    } out;
    out.message.code = MESSAGE_INFO;
    out.message.schema = SCHEMA_HASH;
    out.message.firmware = FIRMWARE_VERSION;
    out.message.baud = BAUD;
    out.message.reset_cause = reset_cause();
    out.message.boots = first_boot;
    send(out.payload, sizeof(info_message), 0);
}

static void send_sample(void) {
    union {
        sample_message message;
        uint8_t payload[sizeof(sample_message) + CHECKSUM];
    } out;
    const sample *oldest = sampling_oldest();
    out.message.code = MESSAGE_SAMPLE;
    out.message.index = index++;
    out.message.time = oldest->time;
    out.message.position = oldest->position;
    out.message.duty = oldest->duty;
    out.message.age = oldest->age;
    out.message.current = oldest->current;
    sampling_drop();
    out.message.state = drive_state();
    out.message.faults = drive_faults();
    send(out.payload, sizeof(sample_message), ANSWERS);
}

static void send_block(void) {
    static union {
        block_message message;
        uint8_t payload[sizeof(block_message) + CHECKSUM];
    } out;
    block_message *block = &out.message;
    int32_t before = 0;
    block->code = MESSAGE_BLOCK;
    block->index = index;
    index += BLOCK_SAMPLES;
    for (uint8_t i = 0; i < BLOCK_SAMPLES; i++) {
        const sample *oldest = sampling_oldest();
        if (i == 0) {
            block->time = oldest->time;
            block->position = oldest->position;
        } else {
            block->delta[i - 1] = (int16_t)(oldest->position - before);
        }
        before = oldest->position;
        block->duty[i] = oldest->after;
        block->current[i] = oldest->current;
        sampling_drop();
    }
    block->table_next = drive_table_next();
    block->state = drive_state();
    block->faults = drive_faults();
    send(out.payload, sizeof(block_message), ANSWERS);
}

static uint8_t start_sampling(const sampling_message *message) {
    if (message->block > 1)
        return REFUSED_VALUE;
    if (!message->period && drive_needs_samples())
        return REFUSED_STATE;
    sampling_start(message->period);
    index = 0;
    blocks = message->block;
    return REFUSED_NONE;
}

/* What anybody may say. */
static uint8_t take_common(const uint8_t *payload, uint8_t length) {
    switch (payload[0]) {
    case MESSAGE_HELLO:
        if (length != sizeof(hello_message))
            return REFUSED_UNKNOWN;
        send_info();
        return ((const hello_message *)payload)->schema == SCHEMA_HASH ? REFUSED_NONE : REFUSED_SCHEMA;
    case MESSAGE_CLAIM: {
        const claim_message *claim = (const claim_message *)payload;
        if (length != sizeof(claim_message))
            return REFUSED_UNKNOWN;
        if (claim->schema != SCHEMA_HASH)
            return REFUSED_SCHEMA;
        uint8_t refusal = drive_claim(claim->owner);
        if (refusal == REFUSED_NONE)
            first_boot = 0;
        return refusal;
    }
    case MESSAGE_STOP: /* of any length: a stop is a stop */
        return drive_stop();
    case MESSAGE_CLEAR:
        return length == sizeof(clear_message) ? drive_clear() : REFUSED_UNKNOWN;
#ifdef TEST_BUILD
    case 0x7f: /* hangs the main loop */
        for (;;)
            ;
#endif
    }
    return REFUSED_UNKNOWN;
}

/* The size of an owner's message, 0 where it isn't one. */
static uint8_t size_of(uint8_t code) {
    switch (code) {
    case MESSAGE_CONFIGURE:
        return sizeof(configure_message);
    case MESSAGE_GAINS:
        return sizeof(gains_message);
    case MESSAGE_SAMPLING:
        return sizeof(sampling_message);
    case MESSAGE_ENABLE:
        return sizeof(enable_message);
    case MESSAGE_DUTY:
        return sizeof(duty_message);
    case MESSAGE_TABLE:
        return sizeof(table_message);
    case MESSAGE_REFERENCE:
        return sizeof(reference_message);
    case MESSAGE_RELEASE:
        return sizeof(release_message);
    case MESSAGE_SET_POSITION:
        return sizeof(set_position_message);
    }
    return 0;
}

/* What only the owner may say. */
static uint8_t take_owned(const uint8_t *payload, uint8_t length) {
    if (length != size_of(payload[0]))
        return REFUSED_UNKNOWN;
    if (!check_agrees(payload, length))
        return REFUSED_DAMAGED;
    uint16_t owner = ((const release_message *)payload)->owner; /* in all of them in the same place */
    if (!owner || owner != drive_owner())
        return REFUSED_OWNER;
    switch (payload[0]) {
    case MESSAGE_CONFIGURE: {
        const configure_message *message = (const configure_message *)payload;
        return drive_configure(message->watchdog_ms, message->stall_duty);
    }
    case MESSAGE_GAINS: {
        const gains_message *message = (const gains_message *)payload;
        return drive_gains(message->kp, message->ki, message->limit);
    }
    case MESSAGE_SAMPLING:
        return start_sampling((const sampling_message *)payload);
    case MESSAGE_ENABLE:
        return drive_enable(((const enable_message *)payload)->mode);
    case MESSAGE_DUTY:
        return drive_actuate(((const duty_message *)payload)->duty);
    case MESSAGE_TABLE:
        return drive_extend_table((const table_message *)payload);
    case MESSAGE_REFERENCE:
        return drive_follow(((const reference_message *)payload)->reference);
    case MESSAGE_RELEASE: {
        uint8_t refusal = drive_release();
        if (refusal == REFUSED_NONE)
            sampling_start(0);
        return refusal;
    }
    case MESSAGE_SET_POSITION:
        return drive_set_position(((const set_position_message *)payload)->position);
    }
    return REFUSED_UNKNOWN;
}

static uint8_t is_actuation(uint8_t code) {
    return code == MESSAGE_DUTY || code == MESSAGE_TABLE || code == MESSAGE_REFERENCE;
}

static void take_frame(const uint8_t *payload, uint8_t length) {
    uint8_t code = payload[0];
    /* HELLO begins a conversation, and with it the count. */
    if (code != MESSAGE_HELLO)
        received_gaps += (uint8_t)(payload[1] - received_sequence - 1);
    received_sequence = payload[1];
    uint8_t refusal = size_of(code) ? take_owned(payload, length) : take_common(payload, length);
    if (refusal != REFUSED_NONE)
        refused++;
    if (refusal != REFUSED_NONE || !is_actuation(code))
        send_status(code, refusal);
}

static void receive(void) {
    int16_t byte;
    /* A frame at most, so that the samples don't wait for a host that talks without an end. */
    while ((byte = serial_take()) >= 0) {
        int8_t length = frame_take(&reader, (uint8_t)byte);
        if (length < 0)
            crc_bad++;
        if (length > 0)
            take_frame(reader.data, (uint8_t)length);
        if (length)
            return;
    }
}

static uint8_t samples_are_due(void) { return sampling_waiting() >= (blocks ? BLOCK_SAMPLES : 1); }

static uint8_t status_is_due(void) {
    return told_state != drive_state() || told_faults != drive_faults() || told_warnings != drive_warnings();
}

uint8_t link_poll(void) {
    receive();
    if (samples_are_due()) {
        if (blocks)
            send_block();
        else
            send_sample();
    }
    if (status_is_due())
        send_status(0, REFUSED_NONE);
    return samples_are_due() || status_is_due();
}
