/* Embree 3.13 and 4.x behind embree.h. What differs between them is in the block marked "version". */
#include "embree.h"

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if LUXGRAPH_EMBREE_MAJOR == 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

_Static_assert(sizeof(lux_packet) == sizeof(struct RTCRay16) &&
                   offsetof(lux_packet, t_min) == offsetof(struct RTCRay16, tnear) &&
                   offsetof(lux_packet, direction) == offsetof(struct RTCRay16, dir_x) &&
                   offsetof(lux_packet, t_max) == offsetof(struct RTCRay16, tfar) &&
                   offsetof(lux_packet, mask) == offsetof(struct RTCRay16, mask) &&
                   offsetof(lux_packet, limit) == offsetof(struct RTCRay16, id) &&
                   offsetof(lux_packet, flags) == offsetof(struct RTCRay16, flags),
               "a packet has Embree's layout");

_Static_assert(sizeof(lux_query) >= sizeof(struct RTCRayHit16) + LUX_PACKET * sizeof(uint32_t) &&
                   offsetof(lux_query, u) == offsetof(struct RTCRayHit16, hit.u) &&
                   offsetof(lux_query, v) == offsetof(struct RTCRayHit16, hit.v) &&
                   offsetof(lux_query, primitive) == offsetof(struct RTCRayHit16, hit.primID) &&
                   offsetof(lux_query, geometry) == offsetof(struct RTCRayHit16, hit.geomID) &&
                   offsetof(lux_query, instance) == offsetof(struct RTCRayHit16, hit.instID),
               "a query has Embree's layout");

struct lux_scene {
    RTCDevice device;
    RTCScene scene;
    /* The corners of each quad, four points each, for the filter. */
    float *corners;
    /* The surface of each quad. */
    uint32_t *quad_surface;
    lux_round *rounds;
    /* Who tells where rays meet them. */
    lux_meet meet;
    const void *meet_rounds;
    /* Embree's number of the geometry that holds these. */
    unsigned round_geometry;
};

/* Embree 4.3 appended instPrimID to its hits, one word per ray. The headers may be older than the library
 * that is loaded (any 4.x can stand in for another), so room is left for it behind the hit. */
struct roomy_hit {
    struct RTCRayHit of;
    uint32_t room[16];
};

/* Version: a context goes before the ray in Embree 3, optional arguments after it in 4. */
#if RTC_VERSION_MAJOR >= 4
static void intersect1(RTCScene scene, struct RTCRayHit *hit) { rtcIntersect1(scene, hit, NULL); }
static void intersect16(const int *valid, RTCScene scene, struct RTCRayHit16 *hit) {
    rtcIntersect16(valid, scene, hit, NULL);
}
static void occluded1(RTCScene scene, struct RTCRay *ray) { rtcOccluded1(scene, ray, NULL); }
static void occluded16(const int *valid, RTCScene scene, struct RTCRay16 *ray) {
    rtcOccluded16(valid, scene, ray, NULL);
}
#else
static void intersect1(RTCScene scene, struct RTCRayHit *hit) {
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene, &context, hit);
}
static void intersect16(const int *valid, RTCScene scene, struct RTCRayHit16 *hit) {
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect16(valid, scene, &context, hit);
}
static void occluded1(RTCScene scene, struct RTCRay *ray) {
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded1(scene, &context, ray);
}
static void occluded16(const int *valid, RTCScene scene, struct RTCRay16 *ray) {
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded16(valid, scene, &context, ray);
}
#endif

/* Flush-to-zero and denormals-are-zero, as Embree asks. The setting is per thread and would change the caller's
 * arithmetic, so each batch puts the old one back. */
static unsigned enter_batch(void) {
#if defined(__SSE2__)
    unsigned before = _mm_getcsr();
    _mm_setcsr(before | 0x8040u);
    return before;
#else
    return 0;
#endif
}

static void leave_batch(unsigned before) {
#if defined(__SSE2__)
    _mm_setcsr(before);
#else
    (void)before;
#endif
}

/* Keeps the first error while a scene is built: Embree's string lives only during the callback. */
static void keep_message(void *user, enum RTCError code, const char *text) {
    char *message = user;
    if (message[0] == '\0')
        snprintf(message, LUX_MESSAGE_BYTES, "%s (Embree error %d)", text ? text : "no reason given", (int)code);
}

uint32_t lux_version(void) {
    RTCDevice device = rtcNewDevice(NULL);
    if (!device) return 0;
    uint32_t version = (uint32_t)rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION);
    rtcReleaseDevice(device);
    return version;
}

/* Whether a ray that Embree says meets a triangle of a quad can do so. For a triangle in whose plane the ray runs all
 * of Embree's tests are noise, and it reports hits on quads far beside the ray (28 of 2e8 rays, half of them made to
 * graze): in double precision the ray must cross the plane within its limits, and do so in the quad's box; where it runs
 * flat, also no further beside the quad than Embree may shift its edges. */
static int can_meet(const float *quad, int second, const float *origin, const float *direction, const float *limits) {
    const float *a = quad + (second ? 6 : 0), *b = quad + (second ? 9 : 3), *c = quad + (second ? 3 : 9);
    double u[3], v[3], w[3];
    for (int k = 0; k < 3; k++) {
        u[k] = (double)b[k] - a[k];
        v[k] = (double)c[k] - a[k];
        w[k] = (double)a[k] - origin[k];
    }
    double n[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
    double speed = n[0] * direction[0] + n[1] * direction[1] + n[2] * direction[2];
    if (speed == 0.0) return 0;
    double t = (n[0] * w[0] + n[1] * w[1] + n[2] * w[2]) / speed;
    if (!(t >= limits[0] && t <= limits[1])) return 0;
    for (int k = 0; k < 3; k++) {
        double place = origin[k] + t * direction[k];
        double low = quad[k], high = quad[k];
        for (int corner = 1; corner < 4; corner++) {
            double x = quad[3 * corner + k];
            if (x < low) low = x;
            if (x > high) high = x;
        }
        if (!(place >= low - LUX_ROUNDING && place <= high + LUX_ROUNDING)) return 0;
    }
    double n2 = n[0] * n[0] + n[1] * n[1] + n[2] * n[2], d2 = 0.0;
    for (int k = 0; k < 3; k++) d2 += (double)direction[k] * direction[k];
    if (speed * speed > LUX_GRAZING2 * n2 * d2) return 1;
    double largest = 0.0;
    for (int k = 0; k < 3; k++) largest = fmax(largest, fmax(fabs(origin[k]), fabs(origin[k] + (double)direction[k])));
    for (int i = 0; i < 12; i++) largest = fmax(largest, fabs(quad[i]));
    for (int corner = 0; corner < 4; corner++) {
        const float *from = quad + 3 * corner, *to = quad + 3 * ((corner + 1) % 4);
        double e[3], p[3];
        for (int k = 0; k < 3; k++) {
            e[k] = (double)to[k] - from[k];
            p[k] = origin[k] + t * direction[k] - from[k];
        }
        double side = n[0] * (e[1] * p[2] - e[2] * p[1]) + n[1] * (e[2] * p[0] - e[0] * p[2]) +
                      n[2] * (e[0] * p[1] - e[1] * p[0]);
        double size = sqrt(n2 * (e[0] * e[0] + e[1] * e[1] + e[2] * e[2]));
        if (side < -LUX_EDGE_ULPS * FLT_EPSILON * largest * size) return 0;
    }
    return 1;
}

/* Embree calls this before it believes that a ray is blocked, or some rays of a packet. That costs about a third of the
 * rate (12.3 to 8.8 M segments/s scattered, 24 to 16.5 M in tiles of neighbours, two shared cores), nearly all of it
 * for being called; closest hits are confirmed by the caller instead. The layout of rays and hits, one column of
 * N values after the other, is the same in Embree 3 and 4. */
static void filter(const struct RTCFilterFunctionNArguments *args) {
    const float *corners = args->geometryUserPtr;
    const float *ray = (const float *)args->ray, *hit = (const float *)args->hit;
    const uint32_t *ids = (const uint32_t *)args->hit;
    unsigned n = args->N;
    for (unsigned i = 0; i < n; i++) {
        if (args->valid[i] == 0) continue;
        float origin[3] = {ray[i], ray[n + i], ray[2 * n + i]};
        float direction[3] = {ray[4 * n + i], ray[5 * n + i], ray[6 * n + i]};
        /* tfar is that of the hit by now; the ray's own is kept in place of an id. */
        float limits[2] = {ray[3 * n + i], ray[10 * n + i]};
        int second = hit[3 * n + i] + hit[4 * n + i] > 1.0f;
        uint32_t quad = ids[5 * n + i];
        if (!can_meet(corners + 12 * (uint64_t)quad, second, origin, direction, limits)) args->valid[i] = 0;
    }
}

static void attach_quads(RTCDevice device, RTCScene scene, const float *vertices, uint64_t vertex_count,
                         const uint32_t *quads, uint64_t quad_count, int confirm, float *corners) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_QUAD);
    if (!geometry) return;
    /* Buffers that Embree allocates itself carry the padding that its 16-byte loads need. */
    float *v = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float),
                                       vertex_count);
    uint32_t *q = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT4,
                                          4 * sizeof(uint32_t), quad_count);
    if (v && q) {
        memcpy(v, vertices, vertex_count * 3 * sizeof(float));
        memcpy(q, quads, quad_count * 4 * sizeof(uint32_t));
        /* Embree 4 starts with a mask of 1, Embree 3 with all bits. */
        rtcSetGeometryMask(geometry, 0xFFFFFFFFu);
        rtcSetGeometryUserData(geometry, corners);
        if (confirm) rtcSetGeometryOccludedFilterFunction(geometry, filter);
        rtcCommitGeometry(geometry);
        rtcAttachGeometry(scene, geometry);
    }
    rtcReleaseGeometry(geometry);
}

/* Ray i of n, as the caller of lux_scene_new is asked about it. */
static uint32_t meet_round(const lux_scene *scene, unsigned primitive, const float *ray, unsigned n, unsigned i, float *t) {
    lux_ray one = {{ray[i], ray[n + i], ray[2 * n + i]},
                   ray[3 * n + i],
                   {ray[4 * n + i], ray[5 * n + i], ray[6 * n + i]},
                   ray[8 * n + i]};
    return scene->meet(scene->meet_rounds, primitive, &one, t);
}

static void round_bounds(const struct RTCBoundsFunctionArguments *args) {
    const lux_round *round = ((const lux_scene *)args->geometryUserPtr)->rounds + args->primID;
    float low[3], high[3];
    for (int k = 0; k < 3; k++) {
        low[k] = nextafterf((float)(round->low[k] - LUX_ROUNDING), -INFINITY);
        high[k] = nextafterf((float)(round->high[k] + LUX_ROUNDING), INFINITY);
    }
    args->bounds_o->lower_x = low[0], args->bounds_o->lower_y = low[1], args->bounds_o->lower_z = low[2];
    args->bounds_o->upper_x = high[0], args->bounds_o->upper_y = high[1], args->bounds_o->upper_z = high[2];
}

/* Rays and hits stand in columns of N values, as for the filter; a hit follows the twelve columns of its ray. */
static void round_intersect(const struct RTCIntersectFunctionNArguments *args) {
    const lux_scene *scene = args->geometryUserPtr;
    unsigned n = args->N;
    float *ray = (float *)args->rayhit, *hit = ray + 12 * n;
    uint32_t *ids = (uint32_t *)hit;
    for (unsigned i = 0; i < n; i++) {
        float t;
        if (args->valid[i] == 0 || !meet_round(scene, args->primID, ray, n, i, &t)) continue;
        ray[8 * n + i] = t;
        hit[3 * n + i] = hit[4 * n + i] = 0.0f;
        ids[5 * n + i] = args->primID;
        ids[6 * n + i] = args->geomID;
        ids[7 * n + i] = RTC_INVALID_GEOMETRY_ID;
    }
}

static void round_occluded(const struct RTCOccludedFunctionNArguments *args) {
    const lux_scene *scene = args->geometryUserPtr;
    unsigned n = args->N;
    float *ray = (float *)args->ray;
    for (unsigned i = 0; i < n; i++) {
        float t;
        if (args->valid[i] != 0 && meet_round(scene, args->primID, ray, n, i, &t)) ray[8 * n + i] = -INFINITY;
    }
}

static unsigned attach_rounds(RTCDevice device, RTCScene scene, lux_scene *made, uint64_t count) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
    if (!geometry) return RTC_INVALID_GEOMETRY_ID;
    rtcSetGeometryUserPrimitiveCount(geometry, (unsigned)count);
    rtcSetGeometryMask(geometry, 0xFFFFFFFFu);
    rtcSetGeometryUserData(geometry, made);
    rtcSetGeometryBoundsFunction(geometry, round_bounds, NULL);
    rtcSetGeometryIntersectFunction(geometry, round_intersect);
    rtcSetGeometryOccludedFunction(geometry, round_occluded);
    rtcCommitGeometry(geometry);
    unsigned id = rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    return id;
}

lux_scene *lux_scene_new(const float *vertices, uint64_t vertex_count, const uint32_t *quads,
                         const uint32_t *quad_surface, uint64_t quad_count, const lux_round *rounds,
                         uint64_t round_count, lux_meet meet, const void *meet_rounds, int confirm, char *message) {
    message[0] = '\0';
    lux_scene *made = calloc(1, sizeof *made);
    if (made) {
        made->corners = calloc(quad_count + 1, 12 * sizeof(float));
        made->quad_surface = calloc(quad_count + 1, sizeof(uint32_t));
        made->rounds = calloc(round_count + 1, sizeof(lux_round));
        made->round_geometry = RTC_INVALID_GEOMETRY_ID;
        made->meet = meet;
        made->meet_rounds = meet_rounds;
    }
    if (!made || !made->corners || !made->quad_surface || !made->rounds) {
        snprintf(message, LUX_MESSAGE_BYTES, "out of memory");
        lux_scene_free(made);
        return NULL;
    }
    for (uint64_t i = 0; i < 4 * quad_count; i++)
        memcpy(made->corners + 3 * i, vertices + 3 * (uint64_t)quads[i], 3 * sizeof(float));
    if (quad_count > 0) memcpy(made->quad_surface, quad_surface, quad_count * sizeof(uint32_t));
    if (round_count > 0) memcpy(made->rounds, rounds, round_count * sizeof(lux_round));
    made->device = rtcNewDevice(NULL);
    if (!made->device) {
        keep_message(message, rtcGetDeviceError(NULL), "no device could be made");
        lux_scene_free(made);
        return NULL;
    }
    rtcSetDeviceErrorFunction(made->device, keep_message, message);
    made->scene = rtcNewScene(made->device);
    if (made->scene) {
        rtcSetSceneFlags(made->scene, RTC_SCENE_FLAG_ROBUST);
        if (quad_count > 0)
            attach_quads(made->device, made->scene, vertices, vertex_count, quads, quad_count, confirm, made->corners);
        if (round_count > 0)
            made->round_geometry = attach_rounds(made->device, made->scene, made, round_count);
        rtcCommitScene(made->scene);
    }
    /* The message belongs to the caller and is about to go out of reach. */
    rtcSetDeviceErrorFunction(made->device, NULL, NULL);
    if (!made->scene || message[0] != '\0') {
        lux_scene_free(made);
        return NULL;
    }
    return made;
}

void lux_scene_free(lux_scene *scene) {
    if (!scene) return;
    if (scene->scene) rtcReleaseScene(scene->scene);
    if (scene->device) rtcReleaseDevice(scene->device);
    free(scene->corners);
    free(scene->quad_surface);
    free(scene->rounds);
    free(scene);
}

static void fill1(struct RTCRay *to, const lux_ray *from) {
    to->org_x = from->origin[0], to->org_y = from->origin[1], to->org_z = from->origin[2];
    to->dir_x = from->direction[0], to->dir_y = from->direction[1], to->dir_z = from->direction[2];
    to->tnear = from->t_min, to->tfar = from->t_max;
    to->time = 0.0f, to->mask = 0xFFFFFFFFu, to->flags = 0;
    memcpy(&to->id, &from->t_max, sizeof to->id);
}

/* Fills lane i of a packet; the lane takes part unless its ray is empty. */
static void fill16(struct RTCRay16 *to, int *valid, int i, const lux_ray *from) {
    to->org_x[i] = from->origin[0], to->org_y[i] = from->origin[1], to->org_z[i] = from->origin[2];
    to->dir_x[i] = from->direction[0], to->dir_y[i] = from->direction[1], to->dir_z[i] = from->direction[2];
    to->tnear[i] = from->t_min, to->tfar[i] = from->t_max;
    to->time[i] = 0.0f, to->mask[i] = 0xFFFFFFFFu, to->flags[i] = 0;
    memcpy(&to->id[i], &from->t_max, sizeof to->id[i]);
    valid[i] = from->t_min <= from->t_max ? -1 : 0;
}

static lux_hit hit_at(const lux_scene *scene, float t, unsigned geometry, unsigned primitive, int second) {
    if (geometry == scene->round_geometry)
        return (lux_hit){t, scene->rounds[primitive].surface, scene->rounds[primitive].part};
    return (lux_hit){t, scene->quad_surface[primitive], (uint32_t)second};
}

static void closest_singly(const lux_scene *scene, const lux_ray *rays, uint64_t count, lux_hit *hits) {
    unsigned before = enter_batch();
    for (uint64_t i = 0; i < count; i++) {
        struct roomy_hit hit;
        hits[i] = (lux_hit){rays[i].t_max, LUX_MISS, 0};
        if (!(rays[i].t_min <= rays[i].t_max)) continue;
        fill1(&hit.of.ray, &rays[i]);
        hit.of.hit.geomID = RTC_INVALID_GEOMETRY_ID;
        hit.of.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        intersect1(scene->scene, &hit.of);
        if (hit.of.hit.geomID == RTC_INVALID_GEOMETRY_ID) continue;
        int second = hit.of.hit.u + hit.of.hit.v > 1.0f;
        hits[i] = hit_at(scene, hit.of.ray.tfar, hit.of.hit.geomID, hit.of.hit.primID, second);
    }
    leave_batch(before);
}

/* Traces the rays in packet, those in the lanes that are valid. */
static void trace_packet(const lux_scene *scene, const int *valid, lux_query *packet) {
    memset(packet->geometry, 0xFF, sizeof packet->geometry);
    memset(packet->instance, 0xFF, sizeof packet->instance);
    intersect16(valid, scene->scene, (struct RTCRayHit16 *)packet);
}

/* Of what a ray in a traced packet met: whether it lies in the second triangle of a quad. */
static int is_second(const lux_query *packet, int lane) { return packet->u[lane] + packet->v[lane] > 1.0f; }

/* What the ray in a lane of a traced packet met. */
static lux_hit hit_of(const lux_scene *scene, const lux_query *packet, int lane) {
    unsigned geometry = packet->geometry[lane];
    float t = packet->rays.t_max[lane];
    if (geometry == RTC_INVALID_GEOMETRY_ID) return (lux_hit){t, LUX_MISS, 0};
    return hit_at(scene, t, geometry, packet->primitive[lane], is_second(packet, lane));
}

/* What all its rays met. */
static void hits_of(const lux_scene *scene, const lux_query *packet, lux_hits *hits) {
    uint32_t geometry = packet->geometry[0], primitive = packet->primitive[0], others = 0;
    for (int i = 0; i < LUX_PACKET; i++)
        others |= (packet->geometry[i] ^ geometry) | (packet->primitive[i] ^ primitive);
    /* Most packets from an eye meet one quad. */
    if (others == 0 && geometry != RTC_INVALID_GEOMETRY_ID && geometry != scene->round_geometry) {
        uint32_t surface = scene->quad_surface[primitive];
        memcpy(hits->t, packet->rays.t_max, sizeof hits->t);
        for (int i = 0; i < LUX_PACKET; i++) hits->surface[i] = surface;
        for (int i = 0; i < LUX_PACKET; i++) hits->part[i] = (uint32_t)is_second(packet, i);
        return;
    }
    for (int i = 0; i < LUX_PACKET; i++) {
        lux_hit hit = hit_of(scene, packet, i);
        hits->t[i] = hit.t, hits->surface[i] = hit.surface, hits->part[i] = hit.part;
    }
}

void lux_closest_packets(const lux_scene *scene, lux_query *packets, uint64_t count, lux_hits *hits) {
    unsigned before = enter_batch();
    for (uint64_t k = 0; k < count; k++) {
        const lux_packet *rays = &packets[k].rays;
        _Alignas(64) int valid[LUX_PACKET];
        /* A lane takes part unless its ray is empty. */
        for (int i = 0; i < LUX_PACKET; i++) valid[i] = rays->t_min[i] <= rays->t_max[i] ? -1 : 0;
        trace_packet(scene, valid, &packets[k]);
        hits_of(scene, &packets[k], &hits[k]);
    }
    leave_batch(before);
}

/* Packets as in lux_occluded_packets below. */
void lux_closest(const lux_scene *scene, const lux_ray *rays, uint64_t count, lux_hit *hits) {
    uint64_t i = 0;
    unsigned before = enter_batch();
    for (; i + LUX_PACKET <= count; i += LUX_PACKET) {
        _Alignas(64) lux_query packet;
        _Alignas(64) int valid[LUX_PACKET];
        struct RTCRay16 *to = (struct RTCRay16 *)&packet.rays;
        for (int lane = 0; lane < LUX_PACKET; lane++) fill16(to, valid, lane, &rays[i + lane]);
        trace_packet(scene, valid, &packet);
        for (int lane = 0; lane < LUX_PACKET; lane++) hits[i + lane] = hit_of(scene, &packet, lane);
    }
    leave_batch(before);
    closest_singly(scene, rays + i, count - i, hits + i);
}

void lux_occluded(const lux_scene *scene, const lux_ray *rays, uint64_t count, uint8_t *blocked) {
    unsigned before = enter_batch();
    for (uint64_t i = 0; i < count; i++) {
        struct RTCRay ray;
        blocked[i] = 0;
        if (!(rays[i].t_min <= rays[i].t_max)) continue;
        fill1(&ray, &rays[i]);
        occluded1(scene->scene, &ray);
        blocked[i] = ray.tfar < 0.0f;
    }
    leave_batch(before);
}

/* Packets measured 1.5 (AVX2) to 2.8 times (AVX-512) as fast as single rays on tiles of neighbouring pairs, and as
 * fast on scattered ones; a packet with few lanes is slower than its rays one by one. */
void lux_occluded_packets(const lux_scene *scene, lux_packet *packets, uint64_t count, uint16_t *blocked) {
    unsigned before = enter_batch();
    for (uint64_t k = 0; k < count; k++) {
        _Alignas(64) int valid[LUX_PACKET];
        unsigned bits = 0;
        /* A lane takes part unless its ray is empty. */
        for (int i = 0; i < LUX_PACKET; i++) valid[i] = packets[k].t_min[i] <= packets[k].t_max[i] ? -1 : 0;
        occluded16(valid, scene->scene, (struct RTCRay16 *)&packets[k]);
        /* Embree marks a blocked ray by tfar = -inf. */
        for (int i = 0; i < LUX_PACKET; i++) bits |= (unsigned)(valid[i] && packets[k].t_max[i] < 0.0f) << i;
        blocked[k] = (uint16_t)bits;
    }
    leave_batch(before);
}
