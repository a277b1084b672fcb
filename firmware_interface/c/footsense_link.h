/* Whether each leg's force may be used now. C99, no allocation, no floats, no clock of its own.
 *
 * Feed it every frame that arrives, and read a leg whenever you need a force. Each leg has one of eight statuses:
 *
 *     OK        the last force is valid, in sequence, and young enough
 *     LOST      the same, but up to max_delta - 1 forces before it did not arrive
 *     REPEATED  the last frame came again: its counter has not advanced
 *     WRONG     a frame failed its check (crc, length, counter, code, or a counter more than max_delta ahead), and
 *               fewer than min_good forces have come since
 *     STALE     no force for `timeout_us`, or fewer than min_good since then; or the force is older than `max_age_us`
 *     UNKNOWN   in sequence, but no `Identity` with their step and version came yet; one comes each second
 *     REFUSED   in sequence, but of a version or a step that this code does not know
 *     CONFLICT  two services send forces of this leg, by their `Identity`: one that has something else, or does not
 *               count on from the last; until 3 s after the last sign of it
 *
 *                    any frame fails its check, or more than max_delta ahead
 *          +----------------------------------------------------------------> WRONG --+
 *          |                                                                          | min_good
 *     OK, LOST, REPEATED <------------------------------------------------------------+ forces
 *          |                                                                          | in order
 *          +----------------------------------------------------------------> STALE --+
 *                    no force for timeout_us
 *
 * A force may be used in OK and LOST, if its state is VALID, or DEGRADED where you accept that. It has arrived when its
 * `Force` and the `Quality` of the same counter have, in either order: `Quality` has the age, without which a force may
 * be of any age. The age is that in `Quality` plus the time since the first of the two arrived. A `Force` with a state
 * that forbids its use ends the use of the last force at once. A leg that was silent for 0.3 s may have been started
 * anew, with other feet: its forces wait for the next `Identity`.
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
    FOOTSENSE_LINK_WRONG = 4,
    FOOTSENSE_LINK_UNKNOWN = 5,
    FOOTSENSE_LINK_REFUSED = 6,
    FOOTSENSE_LINK_CONFLICT = 7
} footsense_status;

typedef struct {
    uint32_t max_age_us;  /* a force older than this is stale */
    uint32_t timeout_us;  /* without a force for this long, the link is down */
    uint8_t max_delta;    /* largest step of the counter, 1..14; max_delta - 1 forces may be lost in a row */
    uint8_t min_good;     /* forces in sequence before the link is OK (again), at least 1 */
    bool accept_degraded; /* whether forces of state DEGRADED are used; weigh them by sigma_un */
} footsense_limits;

/* For forces every 11 to 25 ms; max_age_us is the age limit of the service plus the transmission. */
#define FOOTSENSE_DEFAULT_LIMITS {100000u, 100000u, 3u, 3u, false}

/* A leg's force at one time, and whether it may be used. */
typedef struct {
    footsense_status status;
    bool usable;          /* the force may be used */
    uint8_t state;        /* enum footsense_state, as last reported */
    uint8_t flags;        /* enum footsense_flag */
    uint16_t fault_mask;  /* bit e: element e is not usable or overloaded; FOOTSENSE_NO_MASK until it came */
    int32_t force_mn[3];  /* ground reaction: x forward, y left, z up the leg; FOOTSENSE_NO_FORCE unless usable */
    uint32_t sigma_un[3]; /* FOOTSENSE_NO_SIGMA_UN unless usable */
    uint16_t contact_permille; /* probability that the foot is on the ground; FOOTSENSE_NO_RATIO unless usable */
    uint16_t holds_permille;   /* probability that it stands still there; FOOTSENSE_NO_RATIO unless usable and known */
    uint32_t age_us;      /* of the measurement, now; FOOTSENSE_NO_AGE unless usable */
} footsense_leg_force;

/* State machine of one leg; read it through footsense_get_leg_force. */
typedef struct {
    footsense_force force;     /* the last one complete with its quality */
    footsense_quality quality;
    uint64_t arrived_us;
    bool heard;                /* whether a force has arrived */
    footsense_force next_force; /* the force received so far */
    footsense_quality next_quality;
    uint64_t next_us;
    uint8_t next_counter;
    bool has_force;
    bool has_quality;
    uint64_t wrong_us;
    uint8_t n_good;
    footsense_status status;
    footsense_identity identity; /* node 0: none */
    uint64_t identity_us;
    bool conflicted;             /* whether two services have ever sent */
    uint64_t conflict_us;        /* the last sign of it */
    uint16_t fault_mask;
    bool has_mask;
} footsense_leg;

typedef struct {
    footsense_limits limits;
    footsense_leg legs[FOOTSENSE_LEGS];
} footsense_link;

/* Begins with every leg STALE. `limits` is copied. */
void footsense_link_init(footsense_link *link, const footsense_limits *limits);

/* Takes a frame of any id; returns whether it was a `Force`, `Quality`, `Identity` or `Fault` of a
 * leg, valid or not. `now_us` is the time of arrival on a clock that does not step; 64 bits do not wrap. */
bool footsense_feed(footsense_link *link, uint32_t id, const uint8_t *data, uint8_t len, uint64_t now_us);

/* Force of the leg of `node`, 1..8 (lf 1, lm 2, lr 3, rf 4, rm 5, rr 6), at `now_us`. Any other node is STALE and not usable. */
footsense_leg_force footsense_get_leg_force(const footsense_link *link, uint8_t node, uint64_t now_us);

#ifdef __cplusplus
}
#endif

#endif
