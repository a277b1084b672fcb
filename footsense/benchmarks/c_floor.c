/* The floor of `footsense benchmark`: what one cycle of six legs costs where nothing is Python.
 *
 * The same way as the service's, in one call: commands asked for, codes to capacitances to distances, stray and
 * baseline, the elements brought to one time and held against each other, the network two ways for every leg, states,
 * protected CAN frames and those that are due now and then to a socket, counters, and a record into a pipe. It is the
 * way of healthy legs: a leg that is not healthy ends the cycle, and the bench with it. Three things it does not do: its
 * zeros do not follow the feet but are those of the service, it does not say which foot is on the ground, and it does
 * not look for calibrations that age. That is arithmetic on a few hundred numbers; no system call is missing.
 * Plain loops that a compiler turns into vector instructions; no library but the C library. Forces are checked against
 * the service's before anything is timed.
 *
 * Compiled when the bench runs, with -DUNITS for the width of the network's hidden layers.
 */
#define _GNU_SOURCE
#include <math.h>
#include <stdint.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

enum { LEGS = 6, ELEMENTS = 9, N = LEGS * ELEMENTS, ROWS = 2 * LEGS, SEEN = 19, BUCKETS = 16, EVENTS = 4 };

/* ------------------------------------------------------------------ what the foot and the network are */

struct foot {
    double pf_um;              /* capacitance times plate distance [pF um] */
    double gap_um;
    double stray_pf[N], unloaded_pf[N];
    double low_rel[ELEMENTS], high_rel[ELEMENTS];  /* closures that were trained */
    double max_age_ns;
    double residual[ELEMENTS][ELEMENTS];           /* of each element, what the others do not predict */
    double limit, limit_rel;                       /* of that: at rest, and over the root of the sum of squares */
};

struct network {
    float w1[SEEN][UNITS], b1[UNITS], w2[UNITS][UNITS], b2[UNITS];
    float force[UNITS][3], sigma[UNITS][3], sigma_offset[3], linear[ELEMENTS][3], soft;
};

static struct foot foot;
static struct network network __attribute__((aligned(64)));

static double rest_rel[N];                       /* plate distance at rest over the gap */
static double before_rel[N], slope[N];           /* of the reading before */
static int64_t t_before_ns[N], t_before_that_ns[N];
static int counter;
static double period_s[BUCKETS + 1], age_s[LEGS][BUCKETS + 1], scans, state_scans[LEGS];
static int64_t sent_before_ns, heartbeat_due_ns[LEGS], zero_due_ns[LEGS];
static uint8_t crc_table[256], id_crc[0x800];

static uint8_t crc8(uint8_t crc, const uint8_t *data, int n)
{
    for (int i = 0; i < n; i++) crc = crc_table[crc ^ data[i]];
    return crc;
}

void floor_set(const struct foot *new_foot, const float *weights)
{
    foot = *new_foot;
    memcpy(&network, weights, sizeof network);
    for (int byte = 0; byte < 256; byte++) {
        uint8_t crc = (uint8_t)byte;
        for (int bit = 0; bit < 8; bit++) crc = (uint8_t)(crc << 1 ^ (crc & 0x80 ? 0x1D : 0));
        crc_table[byte] = crc;
    }
    for (int id = 0; id < 0x800; id++) {
        const uint8_t bytes[2] = {(uint8_t)id, (uint8_t)(id >> 8)};
        id_crc[id] = crc8(0, bytes, 2);
    }
    for (int i = 0; i < N; i++) before_rel[i] = slope[i] = NAN;
}

void floor_tare(const double *baseline_pf)
{
    for (int i = 0; i < N; i++) rest_rel[i] = foot.pf_um / baseline_pf[i] / foot.gap_um;
}

/* ------------------------------------------------------------------ the network */

/* tanh(x) = 1 - 2 / (exp(2 x) + 1), with exp(y) = 2^n exp(r): n in the exponent's bits, r by its series. */
static void tanh_all(float *restrict x, int n)
{
    for (int i = 0; i < n; i++) {
        float y = 2.0f * x[i];
        y = y > 30.0f ? 30.0f : y;
        y = y < -30.0f ? -30.0f : y;
        const float turned = y * 1.44269504f + 12582912.0f; /* rounds: 1.5 * 2^23 */
        union { float f; int32_t i; } whole = {turned}, scale;
        const float r = y - (turned - 12582912.0f) * 0.693147181f;
        const float e = 1.0f + r * (1.0f + r * (0.5f + r * (1.0f / 6 + r * (1.0f / 24 + r * (1.0f / 120)))));
        scale.i = (whole.i << 23) + 0x3F800000; /* the low bits of `turned` are n */
        x[i] = 1.0f - 2.0f / (e * scale.f + 1.0f);
    }
}

static void layer(const float *restrict in, int n_in, const float *restrict w, const float *restrict b, float *restrict out)
{
    for (int row = 0; row < ROWS; row++) memcpy(out + row * UNITS, b, sizeof(float) * UNITS);
    /* Four rows at a time share each weight that is loaded. */
    for (int row = 0; row < ROWS; row += 4) {
        float *restrict o0 = out + row * UNITS, *restrict o1 = o0 + UNITS, *restrict o2 = o1 + UNITS,
              *restrict o3 = o2 + UNITS;
        for (int k = 0; k < n_in; k++) {
            const float *restrict wk = w + k * UNITS;
            const float a0 = in[row * n_in + k], a1 = in[(row + 1) * n_in + k], a2 = in[(row + 2) * n_in + k],
                        a3 = in[(row + 3) * n_in + k];
            for (int u = 0; u < UNITS; u++) {
                o0[u] += a0 * wk[u];
                o1[u] += a1 * wk[u];
                o2[u] += a2 * wk[u];
                o3[u] += a3 * wk[u];
            }
        }
    }
    tanh_all(out, ROWS * UNITS);
}

static void estimate(float closure_rel[ROWS][ELEMENTS], float force_n[ROWS][3], float sigma_n[ROWS][3])
{
    static float seen[ROWS * SEEN], first[ROWS * UNITS], second[ROWS * UNITS];
    float square[ROWS], size[ROWS];
    for (int row = 0; row < ROWS; row++) {
        float sum = 0;
        for (int e = 0; e < ELEMENTS; e++) sum += closure_rel[row][e] * closure_rel[row][e];
        square[row] = sum / ELEMENTS;
        size[row] = sqrtf(square[row] + network.soft);
        for (int e = 0; e < ELEMENTS; e++) seen[row * SEEN + e] = closure_rel[row][e] / size[row];
        seen[row * SEEN + 2 * ELEMENTS] = size[row]; /* between them, nothing is missing: zeros */
    }
    layer(seen, SEEN, &network.w1[0][0], network.b1, first);
    layer(first, UNITS, &network.w2[0][0], network.b2, second);
    for (int row = 0; row < ROWS; row++) {
        float shape[3] = {0}, ln_sigma[3] = {0}, straight[3] = {0};
        for (int u = 0; u < UNITS; u++)
            for (int axis = 0; axis < 3; axis++) {
                shape[axis] += second[row * UNITS + u] * network.force[u][axis];
                ln_sigma[axis] += second[row * UNITS + u] * network.sigma[u][axis];
            }
        for (int e = 0; e < ELEMENTS; e++)
            for (int axis = 0; axis < 3; axis++) straight[axis] += closure_rel[row][e] * network.linear[e][axis];
        for (int axis = 0; axis < 3; axis++) {
            force_n[row][axis] = straight[axis] + square[row] / size[row] * shape[axis];
            sigma_n[row][axis] = size[row] * expf(ln_sigma[axis] + network.sigma_offset[axis]);
        }
    }
}

/* Whether no element of a leg contradicts the others. */
static int agree(const double *closure_rel)
{
    double sum = 0;
    int good = 1;
    for (int e = 0; e < ELEMENTS; e++) sum += closure_rel[e] * closure_rel[e];
    const double limit = foot.limit + foot.limit_rel * sqrt(sum);
    for (int e = 0; e < ELEMENTS; e++) {
        double residual = 0;
        for (int k = 0; k < ELEMENTS; k++) residual += foot.residual[e][k] * closure_rel[k];
        good &= fabs(residual) <= limit;
    }
    return good;
}

/* ------------------------------------------------------------------ out */

struct frame { uint32_t id; uint8_t length, reserved[3], data[8]; }; /* struct can_frame */

static void protect(struct frame *frame, uint32_t id, uint64_t payload)
{
    frame->id = id;
    frame->length = 8;
    for (int i = 1; i < 8; i++) frame->data[i] = (uint8_t)(payload >> 8 * (i - 1));
    frame->data[0] = crc8(id_crc[id], frame->data + 1, 7);
}

static uint64_t milli(double force_n)
{
    return (uint16_t)(int16_t)lrint(fmax(-32767, fmin(32767, force_n * 1000)));
}

static uint64_t sigma_code(double sigma_n) { return sigma_n < 1.02 ? (uint64_t)(sigma_n * 500 + (1 - 1e-6)) : 510; }

/* Whether something is due that comes every `period_ns`, each leg at its own time. */
static int is_due(int64_t *due_ns, int64_t period_ns, int leg, int64_t now_ns)
{
    if (!*due_ns) *due_ns = now_ns + period_ns * leg / LEGS;
    if (now_ns < *due_ns) return 0;
    *due_ns += (1 + (now_ns - *due_ns) / period_ns) * period_ns;
    return 1;
}

/* Put the heartbeats and zeros that are due behind the forces, as many as there is room for. */
static int add_events(struct frame *frames, int64_t now_ns)
{
    int n = 0;
    for (int leg = 0; leg < LEGS && n < EVENTS; leg++) {
        if (is_due(&heartbeat_due_ns[leg], 200000000, leg, now_ns))
            frames[n++] = (struct frame){.id = 0x701 + (uint32_t)leg, .length = 1, .data = {5}};
        if (n < EVENTS && is_due(&zero_due_ns[leg], 1000000000, leg, now_ns))
            protect(&frames[n++], 0x381 + (uint32_t)leg, (uint64_t)counter);
    }
    return n;
}

static void count(double *histogram, double seconds)
{
    int bucket = 0;
    for (double bound = 1e-3; bucket < BUCKETS - 1 && seconds > bound; bound *= 1.5) bucket++;
    histogram[bucket] += 1;
    histogram[BUCKETS] += seconds;
}

struct record {
    uint32_t length;
    uint16_t n_commands, n_outcomes;
    uint64_t kind, counter;
    int64_t sequence, force_sequence, sent_ns, scan_t_ns[N];
    double capacitance_pf[N];
    int64_t force_t_ns[LEGS];
    double force_n[LEGS][3], sigma_n[LEGS][3], baseline_mean_pf[LEGS], baseline_worst_pf[LEGS];
    int64_t baseline_moved_ns[LEGS];
    uint16_t fault_mask[LEGS];
    uint8_t reading[N], state[LEGS], flags[LEGS], cause[LEGS], baseline_status[LEGS];
};

/* One cycle; returns 0, or 1 + the first leg that gives no force. `force_n` gets shape (legs, 3). */
int floor_cycle(const int32_t *code, const int64_t *t_ns, int64_t now_ns, int socket, int pipe, double *force_n)
{
    static struct record record = {.length = sizeof record, .kind = 1};
    float both_rel[ROWS][ELEMENTS], both_n[ROWS][3], both_sigma_n[ROWS][3];
    struct frame frames[2 * LEGS + EVENTS];
    int unusable = 0;

    while (recv(socket, frames, sizeof frames[0], MSG_DONTWAIT) > 0) {} /* commands: none comes */

    for (int leg = 0; leg < LEGS; leg++) {
        const int first = leg * ELEMENTS;
        int64_t sum_ns = 0, oldest_ns = INT64_MAX;
        int parabolas = 1, good = 1;
        double line[ELEMENTS], parabola[ELEMENTS], plain[ELEMENTS], closures_rel[ELEMENTS];
        for (int i = first; i < first + ELEMENTS; i++) {
            sum_ns += t_ns[i];
            oldest_ns = t_ns[i] < oldest_ns ? t_ns[i] : oldest_ns;
        }
        const int64_t middle_ns = sum_ns / ELEMENTS;
        for (int e = 0; e < ELEMENTS; e++) {
            const int i = first + e;
            const double pf = code[i] * (1.0 / (1 << 19)) - foot.stray_pf[i];
            const double rel = foot.pf_um / pf / foot.gap_um;
            const double elapsed_ns = (double)(t_ns[i] - t_before_ns[i] > 1 ? t_ns[i] - t_before_ns[i] : 1);
            const double twice_ns = (double)(t_ns[i] - t_before_that_ns[i] > 1 ? t_ns[i] - t_before_that_ns[i] : 1);
            const double now_slope = (rel - before_rel[i]) / elapsed_ns;
            const double bend = (now_slope - slope[i]) / twice_ns;
            const double ahead_ns = (double)(middle_ns - t_ns[i]);
            plain[e] = rel;
            line[e] = rel + now_slope * ahead_ns;
            parabola[e] = line[e] + bend * (ahead_ns * (ahead_ns + elapsed_ns));
            parabolas &= isfinite(parabola[e]) != 0;
            good &= isfinite(line[e]) && fabs(ahead_ns) <= 0.75 * elapsed_ns && pf >= 0.5 * foot.unloaded_pf[i];
            before_rel[i] = rel;
            slope[i] = now_slope;
            t_before_that_ns[i] = t_before_ns[i];
            t_before_ns[i] = t_ns[i];
            record.capacitance_pf[i] = pf + foot.stray_pf[i];
            record.scan_t_ns[i] = t_ns[i];
        }
        for (int e = 0; e < ELEMENTS; e++) {
            const double closure_rel = rest_rel[first + e] - (parabolas ? parabola[e] : line[e]);
            closures_rel[e] = closure_rel;
            both_rel[leg][e] = (float)closure_rel;
            both_rel[LEGS + leg][e] = (float)(rest_rel[first + e] - (parabolas ? line[e] : plain[e]));
            good &= closure_rel <= 0.95 && closure_rel >= foot.low_rel[e] && closure_rel <= foot.high_rel[e];
        }
        good &= agree(closures_rel) && (double)(now_ns - oldest_ns) <= foot.max_age_ns;
        if (!good && !unusable) unusable = 1 + leg;
        record.force_t_ns[leg] = middle_ns;
        record.state[leg] = 1;
    }
    if (unusable) return unusable;
    estimate(both_rel, both_n, both_sigma_n);

    struct iovec parts[2 * LEGS + EVENTS];
    struct mmsghdr messages[2 * LEGS + EVENTS];
    memset(messages, 0, sizeof messages);
    counter = (counter + 1) % 15;
    for (int leg = 0; leg < LEGS; leg++) {
        const float *f = both_n[leg];
        double sigma[3];
        for (int axis = 0; axis < 3; axis++) {
            sigma[axis] = hypot(both_sigma_n[leg][axis], f[axis] - both_n[LEGS + leg][axis]);
            force_n[leg * 3 + axis] = record.force_n[leg][axis] = f[axis];
            record.sigma_n[leg][axis] = sigma[axis];
        }
        const int64_t age_ns = now_ns - record.force_t_ns[leg];
        protect(&frames[2 * leg], 0x181 + (uint32_t)leg,
                (uint64_t)(1 << 4 | counter) | milli(f[0]) << 8 | milli(f[1]) << 24 | milli(f[2]) << 40);
        protect(&frames[2 * leg + 1], 0x281 + (uint32_t)leg,
                (uint64_t)counter | 1 << 4 | (uint64_t)((age_ns + 99999) / 100000) << 8 | sigma_code(sigma[0]) << 29
                    | sigma_code(sigma[1]) << 38 | sigma_code(sigma[2]) << 47);
        count(age_s[leg], (double)age_ns * 1e-9);
        state_scans[leg] += 1;
    }
    const int n_frames = 2 * LEGS + add_events(frames + 2 * LEGS, now_ns);
    for (int i = 0; i < n_frames; i++) {
        parts[i] = (struct iovec){&frames[i], sizeof frames[i]};
        messages[i].msg_hdr.msg_iov = &parts[i];
        messages[i].msg_hdr.msg_iovlen = 1;
    }
    sendmmsg(socket, messages, (unsigned)n_frames, MSG_DONTWAIT);

    if (sent_before_ns) count(period_s, (double)(now_ns - sent_before_ns) * 1e-9);
    sent_before_ns = now_ns;
    scans += 1;
    record.counter++;
    record.sequence = record.force_sequence++;
    record.sent_ns = now_ns;
    return write(pipe, &record, sizeof record) < 0 ? -1 : 0;
}

/* ------------------------------------------------------------------ in time */

static int64_t now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * INT64_C(1000000000) + t.tv_nsec;
}

/* Sleep to `n` deadlines and do a cycle after each, of scans that are played round and round, each round `round_ns`
 * later than the one before; how late each cycle began goes to `late_ns`. */
void floor_pace(int64_t period_ns, int n, const int32_t *codes, const int64_t *t_ns, const int64_t *now_ns, int n_scans,
                int64_t round_ns, int socket, int sink, int pipe, int drain, int64_t *late_ns)
{
    static int64_t later_ns = 0;
    char swallowed[1 << 16];
    double force_n[LEGS * 3];
    int64_t shifted_ns[N], deadline_ns = now();
    for (int i = 0; i < n; i++) {
        const int scan = i % n_scans;
        if (scan == 0) later_ns += round_ns;
        for (int k = 0; k < N; k++) shifted_ns[k] = t_ns[scan * N + k] + later_ns;
        const int64_t start_ns = now();
        do deadline_ns += period_ns;
        while (deadline_ns <= start_ns);
        const struct timespec deadline = {deadline_ns / 1000000000, deadline_ns % 1000000000};
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &deadline, NULL)) {}
        late_ns[i] = now() - deadline_ns;
        floor_cycle(codes + scan * N, shifted_ns, now_ns[scan] + later_ns, socket, pipe, force_n);
        while (recv(sink, swallowed, sizeof swallowed, MSG_DONTWAIT) > 0) {}
        if (read(drain, swallowed, sizeof swallowed) < 0) continue;
    }
}
