#include "footsense_serial.h"

#include <string.h>

enum { VERSION = 1, LEGS = 8, UNUSED_FLAGS = 0x0C, LAST_PLACE = 8, CRC_AT = 48, RECORD = 50 };
enum { NO_RECORD = 0, LONGEST_TEXT = 60 };

uint16_t footsense_crc16(const uint8_t *data, uint8_t len)
{
    uint16_t crc = 0xFFFFu;
    for (uint8_t i = 0; i < len; i++) {
        /* Eight steps at once: the polynomial is x^16 + x^12 + x^5 + 1. */
        uint32_t x = (uint32_t)crc >> 8 ^ data[i];
        x ^= x >> 4;
        crc = (uint16_t)((uint32_t)crc << 8 ^ x << 12 ^ x << 5 ^ x);
    }
    return crc;
}

static uint8_t *put(uint8_t *to, uint32_t value, int n_bytes)
{
    for (int i = 0; i < n_bytes; i++) {
        *to++ = (uint8_t)(value >> 8 * i & 0xFFu);
    }
    return to;
}

/* Stuffs what stands behind the first of `bytes`, in place: each zero, and the first byte, become the way to the next
 * zero. A record is shorter than the 254 bytes from which COBS would have to insert more. */
static void stuff(uint8_t *bytes, uint8_t len)
{
    uint8_t at = 0;
    for (uint8_t i = 1; i < len; i++) {
        if (bytes[i] == 0) {
            bytes[at] = (uint8_t)(i - at);
            at = i;
        }
    }
    bytes[at] = (uint8_t)(len - at);
}

uint8_t footsense_encode_record(const footsense_record *record, uint8_t out[FOOTSENSE_SERIAL_BYTES])
{
    if (record->leg < 1 || record->leg > LEGS || (record->flags & UNUSED_FLAGS) != 0 || record->flags >> 4 > LAST_PLACE) {
        return 0;
    }
    uint8_t *data = out + 1;
    uint8_t *end = put(data, VERSION, 1);
    end = put(end, record->leg, 1);
    end = put(end, record->flags, 1);
    end = put(end, FOOTSENSE_ELEMENTS, 1);
    end = put(end, record->seq, 2);
    end = put(end, record->step_us, 2);
    end = put(end, record->t_us, 4);
    for (unsigned element = 0; element < FOOTSENSE_ELEMENTS; element++) {
        end = put(end, (uint32_t)record->value_af[element], 4);
    }
    (void)put(end, footsense_crc16(data, CRC_AT), 2);
    stuff(out, RECORD + 1);
    out[FOOTSENSE_SERIAL_BYTES - 1u] = 0;
    return FOOTSENSE_SERIAL_BYTES;
}

uint8_t footsense_encode_sending(uint32_t t_us, const char *text, uint8_t out[FOOTSENSE_SENDING_BYTES])
{
    size_t n = strlen(text);
    if (n > LONGEST_TEXT) {
        return 0;
    }
    uint8_t *end = put(out + 1, NO_RECORD, 3);
    end = put(end, (uint32_t)n, 1);
    end = put(end, 0, 4);
    end = put(end, t_us, 4);
    memcpy(end, text, n);
    end += n;
    end = put(end, footsense_crc16(out + 1, (uint8_t)(end - out - 1)), 2);
    stuff(out, (uint8_t)(end - out));
    *end = 0;
    return (uint8_t)(end - out + 1);
}
