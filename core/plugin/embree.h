/* SPDX-License-Identifier: Apache-2.0 */
/* Embree 3.13 and 4.x by one name. Whatever differs between the two is hidden here and nowhere else. */
#ifndef MARRAM_EMBREE_H
#define MARRAM_EMBREE_H

#if defined(__has_include)
#if __has_include(<embree4/rtcore.h>) && !defined(MARRAM_EMBREE3)
#include <embree4/rtcore.h>
#define MARRAM_EMBREE_MAJOR 4
#endif
#endif
#ifndef MARRAM_EMBREE_MAJOR
#include <embree3/rtcore.h>
#define MARRAM_EMBREE_MAJOR 3
#endif

/* One ray against one committed scene; hints: coherent is nonzero for camera rays. */
static inline void marram_intersect1(RTCScene scene, struct RTCRayHit* rayhit, int coherent) {
#if MARRAM_EMBREE_MAJOR == 4
    struct RTCIntersectArguments args;
    rtcInitIntersectArguments(&args);
    args.flags = coherent ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT;
    rtcIntersect1(scene, rayhit, &args);
#else
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    rtcIntersect1(scene, &context, rayhit);
#endif
}

static inline void marram_occluded1(RTCScene scene, struct RTCRay* ray) {
#if MARRAM_EMBREE_MAJOR == 4
    struct RTCOccludedArguments args;
    rtcInitOccludedArguments(&args);
    rtcOccluded1(scene, ray, &args);
#else
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded1(scene, &context, ray);
#endif
}

/* Sixteen rays at once; valid[i] is -1 for a ray that counts and 0 for one that does not. */
static inline void marram_occluded16(RTCScene scene, const int* valid, struct RTCRay16* rays) {
#if MARRAM_EMBREE_MAJOR == 4
    struct RTCOccludedArguments args;
    rtcInitOccludedArguments(&args);
    args.flags = RTC_RAY_QUERY_FLAG_COHERENT;
    rtcOccluded16(valid, scene, rays, &args);
#else
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    rtcOccluded16(valid, scene, &context, rays);
#endif
}

static inline void marram_intersect16(RTCScene scene, const int* valid, struct RTCRayHit16* rayhits) {
#if MARRAM_EMBREE_MAJOR == 4
    struct RTCIntersectArguments args;
    rtcInitIntersectArguments(&args);
    args.flags = RTC_RAY_QUERY_FLAG_COHERENT;
    rtcIntersect16(valid, scene, rayhits, &args);
#else
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    rtcIntersect16(valid, scene, &context, rayhits);
#endif
}

#endif
