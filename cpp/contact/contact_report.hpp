// Outcome of the contact passes of some steps.
#pragma once

#include <cstdint>

namespace clothsim {

struct ContactReport {
    std::int64_t trapped = -1;  // first mass point between spheres that left it no place, or -1
    std::int64_t pinned_inside = -1;  // first pinned point that a sphere has run into, or -1
    // First point of a cell that is larger than a sphere it touches, or -1.
    std::int64_t large_cell = -1;
    // Points that were nearer to a sphere than they may be when a call or a scene brought them.
    struct Start {
        std::int64_t points = 0, sphere = -1, deepest = -1;  // first sphere, and its deepest point
        double depth = 0;  // m
    } start;
    bool changed = false;  // whether a response changed a mass point
    std::int64_t responses = 0;  // of "reflect" and "ray"
    double depth = 0;  // largest of mass points below a sphere's surface [m]
    double lift_work = 0;  // against what pressed points on to a sphere when cells lifted them [J]

    // The first of each kind counts.
    void note(const ContactReport& later) {
        keep_first(trapped, later.trapped);
        keep_first(pinned_inside, later.pinned_inside);
        if (start.points == 0) start = later.start;
    }
    static void keep_first(std::int64_t& first, std::int64_t i) { first = first < 0 ? i : first; }
};

}  // namespace clothsim
