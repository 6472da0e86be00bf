// A C interface to the trees of tinybvh that its author recommends for processors. `scripts/build_tinybvh` compiles it
// over the library's header; `mod.rs` declares the same functions.

#define TINYBVH_IMPLEMENTATION
#include "tiny_bvh.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>

using namespace tinybvh;

namespace {

// raystream's layout.
struct PlainRay {
    float origin[3];
    float t_min;
    float direction[3];
    float t_max;
};

enum Layout : uint32_t { BVH8_AVX2 = 0, BVH4_SSE = 1 };

struct Tree {
    std::unique_ptr<BVH8_CPU> eight;
    std::unique_ptr<BVH4_CPU> four;
};

struct Rays {
    Ray* rays;
    // Lengths of directions, which the library normalises.
    float* lengths;
    size_t count;
};

template <class Bvh>
void build(Bvh& bvh, bool spatial, const bvhvec4* corners, uint32_t triangles) {
    if (spatial) {
        bvh.BuildHQ(corners, triangles);
    } else {
        bvh.Build(corners, triangles);
    }
}

template <class Bvh>
void trace(const Bvh& bvh, Rays& rays, bool any) {
    for (size_t i = 0; i < rays.count; ++i) {
        Ray& ray = rays.rays[i];
        if (any) {
            ray.hit.prim = bvh.IsOccluded(ray) ? 1 : 0;
        } else {
            bvh.Intersect(ray);
        }
    }
}

}  // namespace

extern "C" {

uint32_t raystream_tinybvh_version() {
    return TINY_BVH_VERSION_MAJOR << 16 | TINY_BVH_VERSION_MINOR << 8 | TINY_BVH_VERSION_SUB;
}

// Three corners of four floats for each triangle. They must outlive the tree. Null if memory ends.
void* raystream_tinybvh_build(uint32_t layout, uint32_t spatial, const float* corners, uint32_t triangles) {
    try {
        auto tree = std::make_unique<Tree>();
        const auto* vertices = reinterpret_cast<const bvhvec4*>(corners);
        if (layout == BVH8_AVX2) {
            tree->eight = std::make_unique<BVH8_CPU>();
            build(*tree->eight, spatial != 0, vertices, triangles);
        } else {
            tree->four = std::make_unique<BVH4_CPU>();
            build(*tree->four, spatial != 0, vertices, triangles);
        }
        return tree.release();
    } catch (const std::bad_alloc&) {
        return nullptr;
    }
}

size_t raystream_tinybvh_bytes(const void* handle) {
    const auto* tree = static_cast<const Tree*>(handle);
    return 64 * static_cast<size_t>(tree->eight ? tree->eight->usedBlocks : tree->four->usedBlocks);
}

void raystream_tinybvh_release(void* handle) { delete static_cast<Tree*>(handle); }

// Room for rays. Null if memory ends.
void* raystream_tinybvh_rays(size_t count) {
    auto* rays = new (std::nothrow) Rays{};
    if (rays == nullptr) return nullptr;
    rays->rays = static_cast<Ray*>(std::aligned_alloc(64, sizeof(Ray) * std::max<size_t>(count, 1)));
    rays->lengths = static_cast<float*>(std::malloc(sizeof(float) * std::max<size_t>(count, 1)));
    rays->count = count;
    if (rays->rays == nullptr || rays->lengths == nullptr) {
        std::free(rays->rays);
        std::free(rays->lengths);
        delete rays;
        return nullptr;
    }
    return rays;
}

// Writes as many rays as there is room for. Segments begin at 0 in the library, so rays are moved to their beginnings.
void raystream_tinybvh_set(void* handle, const void* plain) {
    auto* rays = static_cast<Rays*>(handle);
    const auto* from = static_cast<const PlainRay*>(plain);
    for (size_t i = 0; i < rays->count; ++i) {
        const bvhvec3 direction(from[i].direction[0], from[i].direction[1], from[i].direction[2]);
        const bvhvec3 origin(from[i].origin[0], from[i].origin[1], from[i].origin[2]);
        const float start = std::max(from[i].t_min, 0.0f);
        const float length = tinybvh_length(direction);
        const float end = std::min((from[i].t_max - start) * length, static_cast<float>(BVH_FAR));
        rays->rays[i] = Ray(origin + direction * start, direction, end);
        rays->lengths[i] = length;
    }
}

void raystream_tinybvh_trace(const void* handle, void* rays, uint32_t any) {
    const auto* tree = static_cast<const Tree*>(handle);
    if (tree->eight) {
        trace(*tree->eight, *static_cast<Rays*>(rays), any != 0);
    } else {
        trace(*tree->four, *static_cast<Rays*>(rays), any != 0);
    }
}

// Distances of the nearest hits, or ends of rays without one; after any-hit queries 1 where something is hit, else 0.
void raystream_tinybvh_answers(const void* handle, uint32_t any, float* answers) {
    const auto* rays = static_cast<const Rays*>(handle);
    for (size_t i = 0; i < rays->count; ++i) {
        const Intersection& hit = rays->rays[i].hit;
        answers[i] = any != 0 ? static_cast<float>(hit.prim) : hit.t / rays->lengths[i];
    }
}

void raystream_tinybvh_release_rays(void* handle) {
    auto* rays = static_cast<Rays*>(handle);
    std::free(rays->rays);
    std::free(rays->lengths);
    delete rays;
}

}  // extern "C"
