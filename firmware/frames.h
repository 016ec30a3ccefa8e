/* Frames on the serial line: COBS(payload + CRC-16/CCITT-FALSE) and a zero byte. No registers: also compiled for tests. */
#ifndef FRAMES_H
#define FRAMES_H

#include <stdint.h>

#include "protocol.h"

#define RECEIVE_MAX 48 /* the longest encoded frame from the host is a TABLE with 32 bytes */
#define SEND_MAX 76    /* the longest encoded frame to the host is a BLOCK with 70 bytes */

typedef struct {
    uint8_t data[RECEIVE_MAX];
    uint8_t length;
    uint8_t too_long;
} frame_reader;

uint16_t crc16(const uint8_t *data, uint8_t length);

/* Takes a byte. Returns 0 where no frame ends with it, the length of the payload in reader->data where a good one does,
   and -1 where a damaged one does. */
int8_t frame_take(frame_reader *reader, uint8_t byte);

/* `check_agrees`: 1 where a payload ends with its second checksum, CRC-16/T10-DIF of what stands before. The frame's own lets some damage by four
   bits pass, about one in 130,000 such; both together notice any five bits. */
uint8_t check_agrees(const uint8_t *payload, uint8_t length);
uint16_t check16(const uint8_t *data, uint8_t length);

/* Encodes a payload into `frame` (SEND_MAX bytes), its ending zero included; returns the frame's length. The payload must have
   room for its checksum: length + 2 bytes. */
uint8_t frame_encode(uint8_t *payload, uint8_t length, uint8_t *frame);

#endif
