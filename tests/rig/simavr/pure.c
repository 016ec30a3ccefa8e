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

/* Feeds a frame reader with `frames` damaged frames of a DUTY: 1 to 4 bits flipped, a byte lost, a byte doubled, or cut short.
   Returns how many came through with another duty; `accepted` counts all that came through, `caught` those whose checksum and
   owner were right and whose duty only its inverse gave away. */
uint32_t pure_damage(uint32_t frames, uint32_t seed, uint32_t *accepted, uint32_t *caught) {
    frame_reader reader = {{0}, 0, 0};
    int16_t sent[256] = {0};
    uint32_t wrong = 0;
    random_state = seed;
    *accepted = *caught = 0;
    for (uint32_t n = 0; n < frames; n++) {
        uint8_t payload[sizeof(duty_message) + 2], frame[SEND_MAX + 1];
        duty_message *message = (duty_message *)payload;
        memset(payload, 0, sizeof payload);
        message->code = MESSAGE_DUTY;
        message->sequence = (uint8_t)n;
        message->owner = 0x5ebe;
        message->duty = (int16_t)(draw() % (2 * DUTY_FULL + 1)) - DUTY_FULL;
        message->inverse = ~message->duty;
        sent[message->sequence] = message->duty;
        int length = frame_encode(payload, sizeof(duty_message), frame);
        int place = (int)(draw() % (uint32_t)length);
        switch (draw() % 4) {
        case 0:
            for (uint32_t flips = 1 + draw() % 4; flips; flips--)
                frame[draw() % (uint32_t)length] ^= (uint8_t)(1u << draw() % 8);
            break;
        case 1:
            memmove(frame + place, frame + place + 1, (size_t)(--length - place));
            break;
        case 2:
            memmove(frame + place + 1, frame + place, (size_t)(length++ - place));
            break;
        default:
            length = place;
        }
        for (int i = 0; i < length; i++) {
            int8_t found = frame_take(&reader, frame[i]);
            const duty_message *heard = (const duty_message *)reader.data;
            if (found != (int8_t)sizeof(duty_message) || heard->code != MESSAGE_DUTY || heard->owner != 0x5ebe)
                continue;
            if (!duty_agrees(heard)) {
                ++*caught;
                continue;
            }
            ++*accepted;
            wrong += heard->duty != sent[heard->sequence]; /* a whole frame may be heard late, after one that lost its end */
        }
    }
    return wrong;
}
