/* What the tests of the firmware's register-free files call: loops that would be slow in Python. */
#include "extend.h"
#include "frames.h"
#include "protocol.h"
#include "states.h"
#include "table.h"

#include <string.h>

uint8_t pure_next_state(uint8_t state, uint8_t event) { return next_state(state, (drive_event)event); }

/* Moves a counter of 16 bits by `step` as often as `times`, extends it each time, and returns the position it comes to. */
int32_t pure_extend(int32_t position, int16_t step, uint32_t times) {
    uint16_t counter = (uint16_t)position, before = counter;
    while (times--) {
        counter = (uint16_t)(counter + (uint16_t)step);
        position = position_after(position, counter_change(counter, before));
        before = counter;
    }
    return position;
}

static uint32_t random_state;

static uint32_t draw(void) { /* xorshift32 */
    random_state ^= random_state << 13;
    random_state ^= random_state >> 17;
    random_state ^= random_state << 5;
    return random_state;
}

static uint16_t bytes[256]; /* the second checksum of each byte: what the firmware, short of room, does by nibbles */

static uint16_t check_by_bytes(const uint8_t *data, uint8_t length) {
    uint16_t crc = 0;
    while (length--)
        crc = (uint16_t)(crc << 8) ^ bytes[(uint8_t)(crc >> 8) ^ *data++];
    return crc;
}

static void fill_duty(uint8_t *payload) {
    duty_message *message = (duty_message *)payload;
    message->code = MESSAGE_DUTY;
    message->duty = (int16_t)(draw() % (2 * DUTY_FULL + 1)) - DUTY_FULL;
}

static void fill_table(uint8_t *payload, uint32_t n) {
    table_message *message = (table_message *)payload;
    message->code = MESSAGE_TABLE;
    message->first = n * TABLE_CHUNK;
    message->count = TABLE_CHUNK;
    for (int i = 0; i < TABLE_CHUNK; i++)
        message->duty[i] = (int16_t)(draw() % (2 * DUTY_FULL + 1)) - DUTY_FULL;
}

/* Damages a frame: 1 to 4 bits flipped, a byte lost, a byte doubled, or cut short; returns its length then. */
static int damage(uint8_t *frame, int length) {
    int place = (int)(draw() % (uint32_t)length);
    switch (draw() % 4) {
    case 0:
        for (uint32_t flips = 1 + draw() % 4; flips; flips--)
            frame[draw() % (uint32_t)length] ^= (uint8_t)(1u << draw() % 8);
        return length;
    case 1:
        memmove(frame + place, frame + place + 1, (size_t)(length - 1 - place));
        return length - 1;
    case 2:
        memmove(frame + place + 1, frame + place, (size_t)(length - place));
        return length + 1;
    }
    return place;
}

/* So many frames are made at a time, one after the other damaged, and then again, otherwise: making one takes longer than taking
   it. Both checksums are linear, so that damage passes or not whatever else the frame holds; neighbours differ as before. */
enum { BATCH = 64, TIMES = 4 };

/* Feeds a frame reader with `frames` damaged frames of a DUTY or, `table` 1, of a TABLE. Returns how many came through with
   another payload than was sent; `accepted` counts all that came through, `caught` those whose own checksum was right and that
   only the second one gave away. */
uint32_t pure_damage(uint32_t frames, uint32_t seed, int table, uint32_t *accepted, uint32_t *caught) {
    static uint8_t sent[256][sizeof(table_message)], whole[BATCH][SEND_MAX + 1];
    int lengths[BATCH];
    frame_reader reader = {{0}, 0, 0};
    uint32_t wrong = 0, made = 0;
    random_state = seed;
    *accepted = *caught = 0;
    for (int each = 0; each < 256; each++)
        bytes[each] = check16((const uint8_t[]){(uint8_t)each}, 1);
    const uint8_t size = table ? sizeof(table_message) : sizeof(duty_message);
    for (uint32_t n = 0; n < frames; n++) {
        uint8_t frame[SEND_MAX + 1];
        uint32_t at = n % BATCH;
        if (n % (BATCH * TIMES) < BATCH) {
            uint8_t payload[sizeof(table_message) + 2];
            memset(payload, 0, sizeof payload);
            if (table)
                fill_table(payload, made);
            else
                fill_duty(payload);
            payload[1] = (uint8_t)made++;
            ((duty_message *)payload)->owner = 0x5ebe;
            uint16_t check = check_by_bytes(payload, (uint8_t)(size - 2));
            memcpy(payload + size - 2, &check, 2);
            memcpy(sent[payload[1]], payload, size);
            lengths[at] = frame_encode(payload, size, whole[at]);
        }
        memcpy(frame, whole[at], sizeof frame);
        int length = damage(frame, lengths[at]);
        for (int i = 0; i < length; i++) {
            if (frame_take(&reader, frame[i]) != (int8_t)size)
                continue;
            if (!check_agrees(reader.data, size)) {
                ++*caught;
                continue;
            }
            ++*accepted;
            /* A whole frame may be heard late, after one that lost its end. */
            wrong += memcmp(reader.data, sent[reader.data[1]], size) != 0;
        }
    }
    return wrong;
}
