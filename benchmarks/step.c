/* One step of both estimators in plain C, for kernel_speed.py: how far are the compiled kernels from C?
 *
 * The same algorithm as aircraft_sysid_ros: prediction (3.10), (3.11) with the 18-state transition in blocks, iterated
 * update (3.15)-(3.18) with dense rows of H and the Joseph form, recursive least squares (4.12)-(4.14) with directional
 * forgetting, and lagged sums. Sizes are constants, nothing is allocated. Matrices are row-major. */
#include <math.h>
#include <string.h>

#define N 18        /* error: velocity, position, attitude, accelerometer bias, gyro bias, air velocity */
#define LONGEST 6   /* terms of one axis at most */
#define ROW (LONGEST + 2)
enum { V, P_ = 3, A = 6, BA = 9, BG = 12, U = 15 };                 /* first index of each block of the error */
enum { XV, XP = 3, XQ = 6, XBA = 10, XBG = 13, XU = 16, X = 19 };   /* and of the nominal state */

typedef struct {
    double dt, gravity, accelerometer_variance, gyro_variance, accelerometer_walk, gyro_walk, wind_walk;
    double probe[3], gps[3];                 /* from the IMU [m] */
    double variance[9];                      /* V, alpha, beta, GPS position, GPS velocity */
    double forgetting;
    long iterations, lags, offsets[7];
} Setup;

/* --- rotations -------------------------------------------------------------------------------------------- */

static void cross(const double *a, const double *b, double *c) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}
static void cross_matrix(const double *v, double m[3][3]) {
    m[0][0] = m[1][1] = m[2][2] = 0.0;
    m[0][1] = -v[2]; m[0][2] = v[1]; m[1][0] = v[2]; m[1][2] = -v[0]; m[2][0] = -v[1]; m[2][1] = v[0];
}
static void product(double a[3][3], double b[3][3], double c[3][3]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) c[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
}
static void times(double a[3][3], const double *v, double *out) {
    for (int i = 0; i < 3; i++) out[i] = a[i][0] * v[0] + a[i][1] * v[1] + a[i][2] * v[2];
}
static void rotation_matrix(const double *q, double c[3][3]) {
    double w = q[0], x = q[1], y = q[2], z = q[3];
    c[0][0] = w * w + x * x - y * y - z * z; c[0][1] = 2 * (x * y - w * z); c[0][2] = 2 * (x * z + w * y);
    c[1][0] = 2 * (x * y + w * z); c[1][1] = w * w - x * x + y * y - z * z; c[1][2] = 2 * (y * z - w * x);
    c[2][0] = 2 * (x * z - w * y); c[2][1] = 2 * (y * z + w * x); c[2][2] = w * w - x * x - y * y + z * z;
}
static void quaternion_product(const double *a, const double *b, double *p) {
    p[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    p[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    p[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
    p[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}
static void quaternion_exp(double scale, const double *w, double *q) {
    double v[3] = {scale * w[0], scale * w[1], scale * w[2]};
    double angle = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    double s = angle < 1e-5 ? 0.5 - angle * angle / 48.0 : sin(0.5 * angle) / angle;
    q[0] = cos(0.5 * angle); q[1] = s * v[0]; q[2] = s * v[1]; q[3] = s * v[2];
}
static void turn(const double *q, double scale, const double *w, double *out) { /* q (x) exp(scale w), unit length */
    double e[4], n;
    quaternion_exp(scale, w, e);
    quaternion_product(q, e, out);
    n = sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2] + out[3] * out[3]);
    for (int i = 0; i < 4; i++) out[i] /= n;
}
static void right_jacobian(const double *v, double j[3][3]) {
    double angle2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2], a, b, s[3][3], s2[3][3];
    if (angle2 < 1e-8) {
        a = 0.5 - angle2 / 24.0; b = 1.0 / 6.0 - angle2 / 120.0;
    } else {
        double angle = sqrt(angle2);
        a = (1.0 - cos(angle)) / angle2; b = (angle - sin(angle)) / (angle2 * angle);
    }
    cross_matrix(v, s);
    product(s, s, s2);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) j[i][k] = (i == k) - a * s[i][k] + b * s2[i][k];
}

/* --- prediction ------------------------------------------------------------------------------------------- */

typedef struct { double va[3][3], vb[3][3], vg[3][3], aa[3][3], ag[3][3], ua[3][3], ub[3][3], ug[3][3]; } Blocks;

static void transition_blocks(const double *x, const double *f, const double *omega, double dt, double gravity,
                              Blocks *b) {
    double q[4], begin[3][3], turn_half[3][3], turn_half_t[3][3], half[3][3], across[3][3], turned[3][3];
    double to_end[3][3], m[3][3], m2[3][3], down[3], moved[3], u_end[3], v[3];
    rotation_matrix(x + XQ, begin);
    quaternion_exp(0.5 * dt, omega, q); rotation_matrix(q, turn_half);
    quaternion_exp(-dt, omega, q); rotation_matrix(q, b->aa);
    product(begin, turn_half, half);
    cross_matrix(f, across);
    product(half, across, turned);
    product(b->aa, turn_half, to_end);
    for (int i = 0; i < 3; i++) for (int j = 0; j < 3; j++) turn_half_t[i][j] = turn_half[j][i];
    product(turned, turn_half_t, b->va);
    for (int i = 0; i < 3; i++) down[i] = begin[2][i] * gravity;
    times(turn_half, f, moved);
    for (int i = 0; i < 3; i++) v[i] = x[XU + i] + dt * (moved[i] + down[i]);
    times(b->aa, v, u_end);
    for (int i = 0; i < 3; i++) v[i] = dt * omega[i];
    right_jacobian(v, b->ag);
    cross_matrix(down, m);
    product(b->aa, m, b->ua);
    product(to_end, across, b->ug);
    for (int i = 0; i < 3; i++) for (int j = 0; j < 3; j++) {
        b->va[i][j] *= -dt; b->vb[i][j] = -dt * half[i][j]; b->vg[i][j] = 0.5 * dt * dt * turned[i][j];
        b->ag[i][j] *= -dt; b->ua[i][j] *= dt; b->ub[i][j] = -dt * to_end[i][j];
    }
    cross_matrix(u_end, m);
    product(m, b->ag, m2); /* ag holds -J dt */
    for (int i = 0; i < 3; i++) for (int j = 0; j < 3; j++) b->ug[i][j] = 0.5 * dt * dt * b->ug[i][j] + m2[i][j];
}

static void propagate_state(double *x, const double *f, const double *omega, double dt, double gravity) {
    double begin[3][3], half[3][3], end[3][3], q[4], e[4], through_air[3], step[3];
    rotation_matrix(x + XQ, begin);
    quaternion_exp(0.5 * dt, omega, e); quaternion_product(x + XQ, e, q); rotation_matrix(q, half);
    turn(x + XQ, dt, omega, q); rotation_matrix(q, end);
    times(half, f, step);
    for (int i = 0; i < 3; i++) {
        step[i] = dt * (step[i] + (i == 2 ? gravity : 0.0));
        through_air[i] = begin[i][0] * x[XU] + begin[i][1] * x[XU + 1] + begin[i][2] * x[XU + 2] + step[i];
        x[XP + i] += dt * (x[XV + i] + 0.5 * step[i]);
        x[XV + i] += step[i];
    }
    for (int i = 0; i < 3; i++)
        x[XU + i] = end[0][i] * through_air[0] + end[1][i] * through_air[1] + end[2][i] * through_air[2];
    memcpy(x + XQ, q, sizeof q);
}

#define ROW3(b, i, a, c) ((b)[i][0] * m[a][c] + (b)[i][1] * m[a + 1][c] + (b)[i][2] * m[a + 2][c])
static void apply_transition(double m[N][N], const Blocks *b, double dt) { /* Phi m, in place */
    double velocity[3][N], attitude[3][N], air[3][N];
    for (int i = 0; i < 3; i++)
        for (int c = 0; c < N; c++) {
            velocity[i][c] = ROW3(b->va, i, A, c) + ROW3(b->vb, i, BA, c) + ROW3(b->vg, i, BG, c);
            attitude[i][c] = ROW3(b->aa, i, A, c) + ROW3(b->ag, i, BG, c);
            air[i][c] = ROW3(b->aa, i, U, c) + ROW3(b->ua, i, A, c) + ROW3(b->ub, i, BA, c) + ROW3(b->ug, i, BG, c);
        }
    for (int i = 0; i < 3; i++)
        for (int c = 0; c < N; c++) {
            m[P_ + i][c] += dt * (m[V + i][c] + 0.5 * velocity[i][c]);
            m[V + i][c] += velocity[i][c];
            m[A + i][c] = attitude[i][c];
            m[U + i][c] = air[i][c];
        }
}

static void symmetrise(double p[N][N]) {
    for (int i = 0; i < N; i++)
        for (int j = 0; j < i; j++) p[i][j] = p[j][i] = 0.5 * (p[i][j] + p[j][i]);
}

static void add_process_noise(double p[N][N], const double *x, const Setup *s) {
    double c[3][3], arm[3][3], by_rate, force = s->accelerometer_variance * s->dt * s->dt;
    double rate = s->gyro_variance * s->dt * s->dt;
    rotation_matrix(x + XQ, c);
    cross_matrix(x + XU, arm);
    for (int i = 0; i < 3; i++) {
        p[V + i][V + i] += force;
        p[A + i][A + i] += rate;
        p[BA + i][BA + i] += s->accelerometer_walk * s->accelerometer_walk * s->dt;
        p[BG + i][BG + i] += s->gyro_walk * s->gyro_walk * s->dt;
        p[U + i][U + i] += force + s->wind_walk * s->wind_walk * s->dt;
        for (int j = 0; j < 3; j++) {
            by_rate = arm[i][0] * arm[j][0] + arm[i][1] * arm[j][1] + arm[i][2] * arm[j][2];
            p[U + i][U + j] += rate * by_rate;
            p[V + i][U + j] += force * c[i][j];
            p[U + j][V + i] += force * c[i][j];
            p[U + i][A + j] += rate * arm[i][j];
            p[A + j][U + i] += rate * arm[i][j];
        }
    }
}

static void propagate(double *x, double p[N][N], const double *force, const double *rate, const Setup *s) {
    double f[3], omega[3], transposed[N][N];
    Blocks blocks;
    for (int i = 0; i < 3; i++) { f[i] = force[i] - x[XBA + i]; omega[i] = rate[i] - x[XBG + i]; }
    transition_blocks(x, f, omega, s->dt, s->gravity, &blocks);
    propagate_state(x, f, omega, s->dt, s->gravity);
    apply_transition(p, &blocks, s->dt);
    for (int i = 0; i < N; i++) for (int j = 0; j < N; j++) transposed[j][i] = p[i][j];
    apply_transition(transposed, &blocks, s->dt);
    memcpy(p, transposed, sizeof transposed);
    add_process_noise(p, x, s);
    symmetrise(p);
}

/* --- measurements ----------------------------------------------------------------------------------------- */

enum { AIRSPEED, ALPHA, BETA, GPS_POSITION, GPS_VELOCITY };

static double wrap(double angle) { return angle - 2.0 * M_PI * floor((angle + M_PI) / (2.0 * M_PI)); }

static inline void air_data(int kind, double value, const double *x, const double *omega, const Setup *s,
                            double *residual, double h[1][N]) {
    double v[3], g[3], by_bias[3];
    cross(omega, s->probe, v);
    for (int i = 0; i < 3; i++) v[i] += x[XU + i];
    double uw2 = v[0] * v[0] + v[2] * v[2], v2 = uw2 + v[1] * v[1], uw = sqrt(uw2);
    if (kind == AIRSPEED) {
        residual[0] = value - sqrt(v2);
        for (int i = 0; i < 3; i++) g[i] = v[i] / sqrt(v2);
    } else if (kind == ALPHA) {
        residual[0] = wrap(value - atan2(v[2], v[0]));
        g[0] = -v[2] / uw2; g[1] = 0.0; g[2] = v[0] / uw2;
    } else {
        residual[0] = value - atan2(v[1], uw);
        g[0] = -v[0] * v[1] / (v2 * uw); g[1] = uw / v2; g[2] = -v[2] * v[1] / (v2 * uw);
    }
    cross(g, s->probe, by_bias);
    for (int i = 0; i < 3; i++) { h[0][U + i] = g[i]; h[0][BG + i] = by_bias[i]; }
}

static inline void gps(int kind, const double *values, const double *x, const double *omega, const Setup *s,
                       double *residual, double h[3][N]) {
    double c[3][3], m[3][3], by[3][3], arm[3], place[3], turned[3];
    int block = kind == GPS_POSITION ? P_ : V;
    rotation_matrix(x + XQ, c);
    memcpy(place, values, sizeof place);
    if (kind == GPS_POSITION) {
        memcpy(arm, s->gps, sizeof arm);
    } else {
        cross(omega, s->gps, arm);
        cross_matrix(s->gps, m);
        product(c, m, by);
        for (int i = 0; i < 3; i++) for (int j = 0; j < 3; j++) h[i][BG + j] = by[i][j];
    }
    times(c, arm, turned);
    cross_matrix(arm, m);
    product(c, m, by);
    for (int i = 0; i < 3; i++) {
        residual[i] = place[i] - x[block + i] - turned[i];
        h[i][block + i] = 1.0;
        for (int j = 0; j < 3; j++) h[i][A + j] = -by[i][j];
    }
}

/* --- update ----------------------------------------------------------------------------------------------- */

static void retract(const double *x, const double *delta, double *moved) {
    for (int i = 0; i < 6; i++) moved[i] = x[i] + delta[i];
    turn(x + XQ, 1.0, delta + A, moved + XQ);
    for (int i = 10; i < X; i++) moved[i] = x[i] + delta[i - 1];
}

static inline __attribute__((always_inline)) void solve(const int m, double l[m][m], const double *b, double *y) {
    for (int i = 0; i < m; i++) {
        double s = b[i];
        for (int k = 0; k < i; k++) s -= l[i][k] * y[k];
        y[i] = s / l[i][i];
    }
    for (int i = m - 1; i >= 0; i--) {
        double s = y[i];
        for (int k = i + 1; k < m; k++) s -= l[k][i] * y[k];
        y[i] = s / l[i][i];
    }
}

static inline __attribute__((always_inline)) void joseph(const int m, double p[N][N], double k[N][m], double h[m][N],
                                                         const double *r) {
    double hp[m][N], ph[N][m];
    memset(hp, 0, sizeof hp);
    for (int a = 0; a < m; a++)
        for (int i = 0; i < N; i++) for (int j = 0; j < N; j++) hp[a][j] += h[a][i] * p[i][j];
    for (int i = 0; i < N; i++) for (int j = 0; j < N; j++) for (int a = 0; a < m; a++) p[i][j] -= k[i][a] * hp[a][j];
    for (int i = 0; i < N; i++)
        for (int a = 0; a < m; a++) {
            double s = 0.0;
            for (int j = 0; j < N; j++) s += p[i][j] * h[a][j];
            ph[i][a] = s;
        }
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++)
            for (int a = 0; a < m; a++) p[i][j] += (k[i][a] * r[a] - ph[i][a]) * k[j][a];
    symmetrise(p);
}

static void reset_attitude_error(double p[N][N], const double *delta) {
    double jacobian[3][3], rows[3][N];
    right_jacobian(delta + A, jacobian);
    for (int i = 0; i < 3; i++)
        for (int c = 0; c < N; c++)
            rows[i][c] = jacobian[i][0] * p[A][c] + jacobian[i][1] * p[A + 1][c] + jacobian[i][2] * p[A + 2][c];
    memcpy(p[A], rows, sizeof rows);
    for (int c = 0; c < N; c++) {
        double v[3] = {p[c][A], p[c][A + 1], p[c][A + 2]};
        for (int i = 0; i < 3; i++) p[c][A + i] = jacobian[i][0] * v[0] + jacobian[i][1] * v[1] + jacobian[i][2] * v[2];
    }
    symmetrise(p);
}

/* Returns the normalised innovation squared of the first iteration. */
static inline __attribute__((always_inline)) double fuse(const int m, const int kind, const double *values, double *x,
                                                         double p[N][N], const double *rate, const Setup *s) {
    double eta[X], delta[N] = {0}, h[m][N], residual[m], k[N][m], ph[N][m], l[m][m], nis = 0.0, jacobian[3][3], y[m];
    const double *r = s->variance + (m == 1 ? kind : kind == GPS_POSITION ? 3 : 6);
    memcpy(eta, x, sizeof eta);
    for (long iteration = 0; iteration < s->iterations; iteration++) {
        double omega[3] = {rate[0] - eta[XBG], rate[1] - eta[XBG + 1], rate[2] - eta[XBG + 2]};
        memset(h, 0, sizeof h);
        if (m == 1) air_data(kind, values[0], eta, omega, s, residual, h);
        else gps(kind, values, eta, omega, s, residual, h);
        if (iteration > 0) {
            right_jacobian(delta + A, jacobian);
            for (int a = 0; a < m; a++) {
                double v[3] = {h[a][A], h[a][A + 1], h[a][A + 2]};
                for (int j = 0; j < 3; j++) h[a][A + j] = v[0] * jacobian[0][j] + v[1] * jacobian[1][j] + v[2] * jacobian[2][j];
            }
        }
        for (int a = 0; a < m; a++) for (int j = 0; j < N; j++) residual[a] += h[a][j] * delta[j];
        for (int i = 0; i < N; i++)
            for (int a = 0; a < m; a++) {
                double sum = 0.0;
                for (int j = 0; j < N; j++) sum += p[i][j] * h[a][j];
                ph[i][a] = sum;
            }
        for (int a = 0; a < m; a++)
            for (int b = 0; b <= a; b++) {
                double sum = a == b ? r[a] : 0.0;
                for (int j = 0; j < N; j++) sum += h[a][j] * ph[j][b];
                for (int j = 0; j < b; j++) sum -= l[a][j] * l[b][j];
                l[a][b] = a == b ? sqrt(sum) : sum / l[b][b];
            }
        if (iteration == 0) {
            solve(m, l, residual, y);
            for (int a = 0; a < m; a++) nis += residual[a] * y[a];
        }
        for (int i = 0; i < N; i++) {
            solve(m, l, ph[i], k[i]);
            delta[i] = 0.0;
            for (int a = 0; a < m; a++) delta[i] += k[i][a] * residual[a];
        }
        retract(x, delta, eta);
    }
    joseph(m, p, k, h, r);
    reset_attitude_error(p, delta);
    memcpy(x, eta, sizeof eta);
    return nis;
}

/* --- least squares ---------------------------------------------------------------------------------------- */

static void rls_update(int n, double *theta, double p[LONGEST][LONGEST], const double *x, double y, double forgetting) {
    double px[LONGEST], r = 0.0, error = y;
    for (int i = 0; i < n; i++) {
        px[i] = 0.0;
        for (int j = 0; j < n; j++) px[i] += p[i][j] * x[j];
        r += x[i] * px[i];
        error -= x[i] * theta[i];
    }
    if (!(r > 1e-300) || !isfinite(error)) return;
    double scale = (1.0 - forgetting) / (forgetting * r * (1.0 + r)) - 1.0 / (1.0 + r);
    for (int i = 0; i < n; i++) {
        theta[i] += px[i] / (1.0 + r) * error;
        for (int j = 0; j < n; j++) p[i][j] += scale * px[i] * px[j];
    }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) p[i][j] = p[j][i] = 0.5 * (p[i][j] + p[j][i]);
}

static void add_sample(int m, long lags, double sums[][ROW][ROW], double recent[][ROW], const double *row,
                       double forgetting) {
    memmove(recent[1], recent[0], (lags - 1) * sizeof recent[0]);
    memcpy(recent[0], row, m * sizeof row[0]);
    for (long lag = 0; lag < lags; lag++) {
        int present = !isnan(recent[lag][0]);
        for (int i = 0; i < m; i++)
            for (int j = 0; j < m; j++) {
                sums[lag][i][j] *= forgetting;
                if (present) sums[lag][i][j] += row[i] * recent[lag][j];
            }
    }
}

static void learn(const double *terms, const double *measured, double theta[][LONGEST], double p[][LONGEST][LONGEST],
                  const Setup *s) {
    for (int axis = 0; axis < 6; axis++) {
        int first = s->offsets[axis], n = s->offsets[axis + 1] - first;
        rls_update(n, theta[axis], p[axis], terms + first, measured[axis], s->forgetting);
    }
}

static void add_lagged(const double *terms, const double *measured, double *sums, double *recent, const Setup *s) {
    for (int axis = 0; axis < 6; axis++) {
        int first = s->offsets[axis], n = s->offsets[axis + 1] - first;
        double row[ROW];
        memcpy(row, terms + first, n * sizeof row[0]);
        row[n] = measured[axis];
        row[n + 1] = 1.0;
        add_sample(n + 2, s->lags, (double(*)[ROW][ROW])(sums + axis * s->lags * ROW * ROW),
                   (double(*)[ROW])(recent + axis * s->lags * ROW), row, s->forgetting);
    }
}

/* --- n IMU samples ---------------------------------------------------------------------------------------- */

/* every[5]: prediction, air data, GPS, least squares and lagged sums happen every so many samples, 0: never. Arrays: imu (n + 1, 6), air
 * (n + 1, 3), fixes (n + 1, 6), terms (n + 1, offsets[6]), measured (n + 1, 6), x (19), p (18, 18), theta (6, LONGEST),
 * rls_p (6, LONGEST, LONGEST), sums (6, lags, ROW, ROW), recent (6, lags, ROW). Returns the sum of the normalised
 * innovations squared. */
double run(long n, const long *every, const double *imu, const double *air, const double *fixes, const double *terms,
           const double *measured, const Setup *s, double *x, double *p, double *theta, double *rls_p, double *sums,
           double *recent) {
    double(*cov)[N] = (double(*)[N])p, nis = 0.0;
    for (long k = 1; k <= n; k++) {
        const double *before = imu + 6 * (k - 1), *now = imu + 6 * k;
        if (every[0] && k % every[0] == 0) {
            double middle[6];
            for (int i = 0; i < 6; i++) middle[i] = before[i] + 0.5 * (now[i] - before[i]);
            propagate(x, cov, middle, middle + 3, s);
        }
        if (every[1] && k % every[1] == 0) {
            nis += fuse(1, AIRSPEED, air + 3 * k, x, cov, now + 3, s);
            nis += fuse(1, ALPHA, air + 3 * k + 1, x, cov, now + 3, s);
            nis += fuse(1, BETA, air + 3 * k + 2, x, cov, now + 3, s);
        }
        if (every[2] && k % every[2] == 0) {
            nis += fuse(3, GPS_POSITION, fixes + 6 * k, x, cov, now + 3, s);
            nis += fuse(3, GPS_VELOCITY, fixes + 6 * k + 3, x, cov, now + 3, s);
        }
        if (every[3] && k % every[3] == 0)
            learn(terms + s->offsets[6] * k, measured + 6 * k, (double(*)[LONGEST])theta,
                  (double(*)[LONGEST][LONGEST])rls_p, s);
        if (every[4] && k % every[4] == 0)
            add_lagged(terms + s->offsets[6] * k, measured + 6 * k, sums, recent, s);
    }
    return nis;
}
