// Outcome of the contacts of a step.
#pragma once

#include <cstdint>

namespace clothsim {

struct ContactReport {
    std::int64_t trapped = -1;        // first mass point between spheres that left it no place, or -1
    std::int64_t pinned_inside = -1;  // first pinned point that a sphere has run into, or -1
    std::int64_t capped = -1;  // first point in contact whose cells are larger than a sphere, or -1
    bool changed = false;             // whether a response changed a mass point
    std::int64_t responses = 0;  // of "reflect" and "ray"

    // The first of each kind counts.
    void note(const ContactReport& later) {
        note_trapped(later.trapped);
        note_pinned(later.pinned_inside);
        note_capped(later.capped);
    }
    static void keep_first(std::int64_t& first, std::int64_t i) { first = first < 0 ? i : first; }
    void note_trapped(std::int64_t i) { keep_first(trapped, i); }
    void note_capped(std::int64_t i) { keep_first(capped, i); }
    void note_pinned(std::int64_t i) { keep_first(pinned_inside, i); }
};

}  // namespace clothsim
