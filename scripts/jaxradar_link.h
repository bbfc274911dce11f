/* The board's side of jaxradar's framed link: one header, no allocation, no library, C99.
 *
 * Feed every byte that the serial line brings to jaxradar_take, with a millisecond clock that may wrap around; ask
 * jaxradar_step_is_coming as often as you like. It is false before the first frame, when a frame said so, when frames
 * stay away for three periods, and when the impact that was told is over. Answer each frame with jaxradar_reply.
 * The layout is that of the module jaxradar.live.wires. MIT licence.
 *
 *     struct jaxradar_link link = {0};
 *     if (jaxradar_take(&link, byte, now_ms)) {
 *         uint8_t out[JAXRADAR_REPLY_BYTES];
 *         jaxradar_reply(&link, acceleration_cm_s2, 0, out);
 *         send(out, sizeof out);
 *     }
 *     damper_soft(jaxradar_step_is_coming(&link, now_ms));
 */
#ifndef JAXRADAR_LINK_H
#define JAXRADAR_LINK_H

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#define JAXRADAR_TELL_BYTES 18
#define JAXRADAR_REPLY_BYTES 12
#define JAXRADAR_IMPACT_UNKNOWN 0xFFFFu
#define JAXRADAR_UNKNOWN INT16_MIN /* of height and acceleration */
#define JAXRADAR_PERIODS 3u        /* without a frame: a time-out */

enum jaxradar_fault {
    JAXRADAR_SENSOR_SILENT = 1,
    JAXRADAR_SENSOR_LOST = 2,
    JAXRADAR_NO_DATA = 4,
    JAXRADAR_WRONG_LENGTH = 8,
    JAXRADAR_LATE = 16,
    JAXRADAR_RECORDER = 32,
    JAXRADAR_STOPPING = 64
};

struct jaxradar_link {
    uint8_t held[JAXRADAR_TELL_BYTES];
    uint8_t count;
    bool any;           /* whether a frame has come */
    uint32_t at_ms;     /* when the last one came */
    uint16_t sequence;  /* its number */
    uint16_t number;    /* of the detection, 0 before any */
    bool event;         /* whether a step is coming */
    uint8_t period_ms;  /* until the next frame */
    uint16_t impact;    /* 0.1 ms from then, JAXRADAR_IMPACT_UNKNOWN */
    int16_t height;     /* 0.1 mm, JAXRADAR_UNKNOWN */
    uint16_t faults;    /* enum jaxradar_fault */
    uint32_t damaged;   /* frames whose checksum was wrong */
};

/* CRC-16/CCITT-FALSE. */
static inline uint16_t jaxradar_crc(const uint8_t *bytes, uint8_t count)
{
    uint16_t crc = 0xFFFFu;
    for (uint8_t i = 0; i < count; i++) {
        crc = (uint16_t)(crc ^ ((uint16_t)bytes[i] << 8));
        for (int bit = 0; bit < 8; bit++)
            crc = (uint16_t)((uint16_t)(crc << 1) ^ (crc & 0x8000u ? 0x1021u : 0u));
    }
    return crc;
}

static inline uint16_t jaxradar_u16(const uint8_t *at)
{
    return (uint16_t)(at[0] | (uint16_t)at[1] << 8); /* an int may have 16 bits */
}

static inline void jaxradar_put(uint8_t *at, uint16_t value)
{
    at[0] = (uint8_t)(value & 0xFFu);
    at[1] = (uint8_t)(value >> 8);
}

/* One byte of the line; true when it ended a frame. */
static inline bool jaxradar_take(struct jaxradar_link *link, uint8_t byte, uint32_t now_ms)
{
    static const uint8_t begin[4] = {0xA5, 0x5A, 1, 12};
    uint8_t *held = link->held;
    held[link->count++] = byte;
    for (;;) {
        uint8_t same = link->count < 4 ? link->count : 4;
        bool is_begin = memcmp(held, begin, same) == 0;
        if (is_begin && link->count < JAXRADAR_TELL_BYTES)
            return false;
        if (is_begin && jaxradar_crc(held + 2, 14) == jaxradar_u16(held + 16))
            break;
        if (is_begin)
            link->damaged++;
        /* Not a frame: look for the begin of one in what came after its first byte. */
        link->count--;
        memmove(held, held + 1, link->count);
        if (link->count == 0)
            return false;
    }
    link->count = 0;
    link->any = true;
    link->at_ms = now_ms;
    link->sequence = jaxradar_u16(held + 4);
    link->number = jaxradar_u16(held + 6);
    link->event = held[8] == 1;
    link->period_ms = held[9];
    link->impact = jaxradar_u16(held + 10);
    link->height = (int16_t)jaxradar_u16(held + 12);
    link->faults = jaxradar_u16(held + 14);
    return true;
}

/* Whether the damper is to be made ready, now. */
static inline bool jaxradar_step_is_coming(const struct jaxradar_link *link, uint32_t now_ms)
{
    uint32_t age_ms = now_ms - link->at_ms;
    if (!link->any || !link->event || age_ms > JAXRADAR_PERIODS * link->period_ms)
        return false;
    return link->impact == JAXRADAR_IMPACT_UNKNOWN || age_ms * 10u <= link->impact;
}

/* The answer to the last frame. Acceleration in 0.01 m/s², upwards positive, or JAXRADAR_UNKNOWN; status: 0, or what the
 * board has to say of itself. */
static inline void jaxradar_reply(const struct jaxradar_link *link, int16_t acceleration, uint16_t status,
                                  uint8_t out[JAXRADAR_REPLY_BYTES])
{
    out[0] = 0xA5;
    out[1] = 0x5A;
    out[2] = 2;
    out[3] = 6;
    jaxradar_put(out + 4, link->sequence);
    jaxradar_put(out + 6, (uint16_t)acceleration);
    jaxradar_put(out + 8, status);
    jaxradar_put(out + 10, jaxradar_crc(out + 2, 8));
}

#endif
