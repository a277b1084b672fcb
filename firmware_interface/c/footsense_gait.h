/* Gait events of the legs: each once, with the time at which it happened. C99, no allocation, no floats, no clock.
 *
 * A frame that comes again, with kind and counter of the leg's last event within a second, is no event: later, it comes
 * from a service that was started anew.
 */
#ifndef FOOTSENSE_GAIT_H
#define FOOTSENSE_GAIT_H

#include "footsense_can.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The last event of each leg; zero it before the first use. */
typedef struct {
    uint64_t arrived_us[FOOTSENSE_LEGS];
    uint8_t counters[FOOTSENSE_LEGS];
    uint8_t kinds[FOOTSENSE_LEGS]; /* 0: none yet */
} footsense_events;

typedef struct {
    uint8_t node;
    uint8_t kind;      /* enum footsense_event_kind */
    bool all_in_air;   /* every leg was known to be without contact then */
    bool has_time;     /* whether t_us is known */
    uint16_t sigma_us; /* standard deviation of t_us; FOOTSENSE_NO_SIGMA */
    uint64_t t_us;     /* when it happened, in the time of `now_us` */
} footsense_event;

/* Takes a frame of any id, which arrived at `now_us`. Returns whether it was a new event; otherwise leaves *out. */
bool footsense_take_event(footsense_events *events, uint32_t id, const uint8_t *data, uint8_t len, uint64_t now_us,
                          footsense_event *out);

#ifdef __cplusplus
}
#endif

#endif
