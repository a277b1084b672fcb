/* Scans the AD7147s of all legs, and sends a record of each leg in every scan. C99, no allocation, no floats; what it needs
 * of a microcontroller is in footsense_port.h. */
#ifndef FOOTSENSE_SCAN_H
#define FOOTSENSE_SCAN_H

#include "../c/footsense_serial.h"
#include "footsense_port.h"
#include "footsense_stages.h"

#define FOOTSENSE_SCAN_US 5000 /* `serial.rate_hz` of the service is 200; a stage converts again after 6.6 ms at least */

typedef struct {
    footsense_stages stages;
    int64_t due_ns;     /* time of its next step */
    int32_t gain_q12;   /* what a code is worth, in 1/4096 aF */
    int32_t offset_af;  /* capacitance of the middle code */
    uint8_t step;       /* of its set-up, or that it is read */
    uint8_t reason;     /* why it has no values, of enum footsense_no_value */
    uint8_t n_doubts;   /* scans in a row whose status did not fit */
    uint8_t n_misses;   /* scans in a row without all values, or tries of its reference */
    uint8_t offset;     /* of its converter [steps] */
    bool is_new;        /* it has taken results in this scan */
    bool starting;      /* its number has not reached 256 */
    uint16_t seq;
} footsense_scan_leg;

typedef struct {
    footsense_scan_leg legs[FOOTSENSE_LEGS];
    int64_t now_ns;     /* the port's clock without its wraps */
    uint32_t next_us;   /* start of the next scan */
    uint8_t stuck;      /* legs that held a line low in the last transaction */
    uint8_t check;      /* settings that are read back in the next scan */
    uint8_t first;      /* leg whose set-up goes on first */
    uint8_t sent[FOOTSENSE_LEGS * FOOTSENSE_SERIAL_BYTES + FOOTSENSE_SENDING_BYTES]; /* bytes on their way */
} footsense_scan;

void footsense_scan_start(footsense_scan *scan);

/* Waits for the next scan, and does it: reads all legs, sends their records, checks settings, sets up what was found. */
void footsense_scan_next(footsense_scan *scan);

#endif
