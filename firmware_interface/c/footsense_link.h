/* How far the forces of every leg may be trusted at this moment. C99, no allocation, no floats, no clock of its own.
 *
 * Feed it every frame that arrives, and ask it whenever you need a force. Each leg has one of five statuses:
 *
 *     OK        the last force is whole, in order, and young enough
 *     LOST      the same, but some before it did not arrive
 *     REPEATED  the last frame came a second time: the counter stands still
 *     WRONG     a frame failed its check (crc, length, counter, code, or too large a gap in the counter), and not
 *               enough good ones have come since
 *     STALE     nothing has come for `timeout_us`, or not enough since then; or the force is older than `max_age_us`
 *
 *                    any frame fails its check, or more than max_delta ahead
 *          +----------------------------------------------------------------> WRONG --+
 *          |                                                                          | min_good
 *     OK, LOST, REPEATED <------------------------------------------------------------+ forces
 *          |                                                                          | in order
 *          +----------------------------------------------------------------> STALE --+
 *                    no force for timeout_us
 *
 * A force may be used in OK and LOST, and if its state is VALID, or DEGRADED where you accept that. It counts as
 * arrived when its `Force` and the `Quality` of the same counter are both there, in either order: the age stands in
 * `Quality`, and a force of which nobody knows the age may be as old as anything. Its age is what `Quality` says plus
 * the time since the first of the two arrived. Bad news needs no proof: a `Force` whose state forbids its use ends
 * the use of the one before at once.
 */
#ifndef FOOTSENSE_LINK_H
#define FOOTSENSE_LINK_H

#include "footsense_can.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum {
    FOOTSENSE_LINK_STALE = 0,
    FOOTSENSE_LINK_OK = 1,
    FOOTSENSE_LINK_LOST = 2,
    FOOTSENSE_LINK_REPEATED = 3,
    FOOTSENSE_LINK_WRONG = 4
} footsense_status;

typedef struct {
    uint32_t max_age_us;  /* a force older than this is stale */
    uint32_t timeout_us;  /* without a force for this long, the link is down */
    uint8_t max_delta;    /* largest step of the counter, 1..14: one less forces may be lost in a row */
    uint8_t min_good;     /* forces in order that it takes to trust the link (again), at least 1 */
    bool accept_degraded; /* whether forces of state DEGRADED are used; weigh them by sigma_mn */
} footsense_limits;

/* For forces every 25 ms. max_age is what the service itself allows for a scan, plus the way. */
#define FOOTSENSE_DEFAULT_LIMITS {100000u, 100000u, 3u, 3u, false}

/* What is known of a leg at a moment. */
typedef struct {
    footsense_status status;
    bool usable;          /* the force may be used */
    uint8_t state;        /* enum footsense_state, as last said */
    uint8_t flags;        /* enum footsense_flag */
    uint16_t fault_mask;
    int16_t force_mn[3];  /* FOOTSENSE_NO_FORCE unless usable */
    uint16_t sigma_mn[3]; /* FOOTSENSE_NO_SIGMA unless usable */
    uint32_t age_us;      /* of the measurement, now; FOOTSENSE_NO_AGE unless usable */
} footsense_leg_force;

/* One leg's memory; read it through footsense_get_leg_force. */
typedef struct {
    footsense_force force;     /* the last that came with its quality */
    footsense_quality quality;
    uint64_t arrived_us;
    bool heard;                /* whether there is one */
    footsense_force next_force; /* the one that is arriving */
    footsense_quality next_quality;
    uint64_t next_us;
    uint8_t next_counter;
    bool has_force;
    bool has_quality;
    uint64_t wrong_us;
    uint8_t n_good;
    footsense_status status;
} footsense_leg;

typedef struct {
    footsense_limits limits;
    footsense_leg legs[FOOTSENSE_LEGS];
} footsense_link;

/* Begins with every leg STALE. `limits` is copied. */
void footsense_link_init(footsense_link *link, const footsense_limits *limits);

/* Takes a frame of any id; returns whether it was a `Force` or `Quality` of a leg, good or not. `now_us` is the time
 * of arrival on a clock that does not step; 64 bits do not wrap. */
bool footsense_feed(footsense_link *link, uint16_t id, const uint8_t *data, uint8_t len, uint64_t now_us);

/* What is known of the leg of `node`, 1..6, at `now_us`. Any other node is STALE and not usable. */
footsense_leg_force footsense_get_leg_force(const footsense_link *link, uint8_t node, uint64_t now_us);

#ifdef __cplusplus
}
#endif

#endif
