/* Records for the serial line, for a microcontroller that scans feet by itself. C99, no allocation, no floats.
 *
 * The same records as ../serial_frames.py, which has the layout and what every field means; ../vectors/serial.json
 * holds for both.
 */
#ifndef FOOTSENSE_SERIAL_H
#define FOOTSENSE_SERIAL_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define FOOTSENSE_ELEMENTS 9u
#define FOOTSENSE_SERIAL_BYTES 52u /* a record on the line, the zero that ends it included */

enum footsense_record_flag {
    FOOTSENSE_LO_SHU = 1,  /* the elements were converted in the order 5 0 7 6 4 2 1 8 3, not 0 to 8 */
    FOOTSENSE_RECORD_STARTING = 2 /* in the first 256 records of a leg since the controller's start */
};

/* A flag as well: the place in that order, 0 to 8, of the conversion that came first; the others follow in turn. */
#define FOOTSENSE_BEGAN_AT(place) ((place) << 4)

#define FOOTSENSE_IDENTIFY 0x05     /* a byte that asks what the controller is */
#define FOOTSENSE_SENDING_BYTES 76u /* of the longest frame that answers */

/* Why an element has no capacitance. */
enum footsense_no_value {
    FOOTSENSE_NO_ANSWER = 1,
    FOOTSENSE_NOT_READY = 2,
    FOOTSENSE_OVER_RANGE = 3,
    FOOTSENSE_MISCONFIGURED = 4,
    FOOTSENSE_BUS_STUCK = 5,
    FOOTSENSE_WRONG_CHIP = 6,
    FOOTSENSE_CORRUPT = 7,
    FOOTSENSE_UNDER_RANGE = 11
};

/* What stands in place of a capacitance that is not there. */
#define FOOTSENSE_NO_VALUE(why) (INT32_MIN + (int32_t)(why))

typedef struct {
    uint8_t leg;       /* node id: 1 lf, 2 lm, 3 lr, 4 rf, 5 rm, 6 rr, 7 l4, 8 r4 */
    uint8_t flags;     /* enum footsense_record_flag and FOOTSENSE_BEGAN_AT */
    uint16_t seq;      /* one more than in the leg's last record */
    uint16_t step_us;  /* from the middle of one conversion to that of the next; 0: all at once */
    uint32_t t_us;     /* middle of the first conversion, the same for the legs of one scan */
    int32_t value_af[FOOTSENSE_ELEMENTS]; /* stray included, flat index 3 * row + column; or FOOTSENSE_NO_VALUE */
} footsense_record;

/* CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, not reflected; "123456789" gives 0x29B1. */
uint16_t footsense_crc16(const uint8_t *data, uint8_t len);

/* Writes a record as it goes on the line and returns FOOTSENSE_SERIAL_BYTES, or 0 and nothing if its leg or one of its
 * flags does not exist. Send the bytes together; zeros between records do no harm, and one at start ends what a reset
 * cut off. */
uint8_t footsense_encode_record(const footsense_record *record, uint8_t out[FOOTSENSE_SERIAL_BYTES]);

/* Writes what may come before the records of a scan: the time at which they are sent, and what the controller is if it was
 * asked, at most 60 characters of ASCII; else an empty text. Returns the number of bytes; 0 and nothing for a longer one. */
uint8_t footsense_encode_sending(uint32_t t_us, const char *text, uint8_t out[FOOTSENSE_SENDING_BYTES]);

#ifdef __cplusplus
}
#endif

#endif
