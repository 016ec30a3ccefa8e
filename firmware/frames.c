#include "frames.h"

/* A nibble at a time: a table of 32 bytes instead of 512. */
static const uint16_t ccitt[16] = {0x0000, 0x1021, 0x2042, 0x3063, 0x4084, 0x50a5, 0x60c6, 0x70e7,
                                   0x8108, 0x9129, 0xa14a, 0xb16b, 0xc18c, 0xd1ad, 0xe1ce, 0xf1ef};

static const uint16_t t10_dif[16] = {0x0000, 0x8bb7, 0x9cd9, 0x176e, 0xb205, 0x39b2, 0x2edc, 0xa56b,
                                     0xefbd, 0x640a, 0x7364, 0xf8d3, 0x5db8, 0xd60f, 0xc161, 0x4ad6};

static uint16_t checksum(const uint16_t *nibbles, uint16_t crc, const uint8_t *data, uint8_t length) {
    while (length--) {
        uint8_t byte = *data++;
        crc = (uint16_t)(crc << 4) ^ nibbles[(uint8_t)(crc >> 12) ^ (byte >> 4)];
        crc = (uint16_t)(crc << 4) ^ nibbles[(uint8_t)(crc >> 12) ^ (byte & 15)];
    }
    return crc;
}

uint16_t crc16(const uint8_t *data, uint8_t length) { return checksum(ccitt, 0xffff, data, length); }

uint16_t check16(const uint8_t *data, uint8_t length) { return checksum(t10_dif, 0, data, length); }

uint8_t check_agrees(const uint8_t *payload, uint8_t length) {
    uint16_t sent = payload[length - 2] | (uint16_t)payload[length - 1] << 8;
    return check16(payload, (uint8_t)(length - 2)) == sent;
}

/* Decodes in place; returns the number of bytes, or -1. */
static int8_t unstuff(uint8_t *data, uint8_t length) {
    uint8_t from = 0, to = 0;
    while (from < length) {
        uint8_t code = data[from++];
        if (code == 0 || code - 1 > length - from)
            return -1;
        for (uint8_t i = 1; i < code; i++)
            data[to++] = data[from++];
        if (from < length)
            data[to++] = 0;
    }
    return (int8_t)to;
}

static int8_t finish(frame_reader *reader) {
    int8_t length = unstuff(reader->data, reader->length);
    if (length < 4) /* a code, a sequence number and a checksum */
        return -1;
    uint16_t sent = reader->data[length - 2] | (uint16_t)reader->data[length - 1] << 8;
    return crc16(reader->data, (uint8_t)(length - 2)) == sent ? (int8_t)(length - 2) : -1;
}

int8_t frame_take(frame_reader *reader, uint8_t byte) {
    if (byte) {
        if (reader->length < RECEIVE_MAX)
            reader->data[reader->length++] = byte;
        else
            reader->too_long = 1;
        return 0;
    }
    int8_t result = 0;
    if (reader->too_long)
        result = -1;
    else if (reader->length)
        result = finish(reader);
    reader->length = reader->too_long = 0;
    return result;
}

uint8_t frame_encode(uint8_t *payload, uint8_t length, uint8_t *frame) {
    uint16_t crc = crc16(payload, length);
    payload[length] = (uint8_t)crc;
    payload[length + 1] = (uint8_t)(crc >> 8);
    uint8_t code_at = 0, to = 1;
    for (uint8_t i = 0; i < length + 2; i++) {
        if (payload[i]) {
            frame[to++] = payload[i];
        } else {
            frame[code_at] = to - code_at;
            code_at = to++;
        }
    }
    frame[code_at] = to - code_at;
    frame[to++] = 0;
    return to;
}
