/* What the scan needs of a microcontroller: the port. Each leg has an I2C bus of its own, and the buses work at the same
 * time, so that all legs are read at once, and a short in one cable is no other leg's. */
#ifndef FOOTSENSE_PORT_H
#define FOOTSENSE_PORT_H

#include <stdint.h>

#define FOOTSENSE_LEGS 6u      /* bit k of a mask is the leg of node id k + 1: lf, lm, lr, rf, rm, rr */
#define FOOTSENSE_ADDRESS 0x2C /* of the chip on each bus: straps ADD0 and ADD1 at ground */
#define FOOTSENSE_READ_MAX 26u /* bytes */

/* Legs whose chips acknowledged a transaction; legs whose SDA or SCL is held low, even after nine clocks. */
typedef struct {
    uint8_t answered, stuck;
} footsense_answer;

/* One transaction with the chip of each leg of a mask, to an end: writes n_out bytes, then reads n_in into its row. */
footsense_answer footsense_transfer(uint8_t legs, const uint8_t *out, uint8_t n_out,
                                    uint8_t in[][FOOTSENSE_READ_MAX], uint8_t n_in);

/* Microseconds of a clock that wraps after 32 bits. */
uint32_t footsense_now_us(void);
void footsense_wait_until_us(uint32_t t_us);

/* Sends bytes that stay as they are until the next call. */
void footsense_send(const uint8_t *bytes, uint16_t n);
/* The next byte that was received, or -1. */
int footsense_receive(void);
/* What the controller is, at most 60 characters. */
extern const char footsense_identity[];

#endif
