// Detection of section 5.1 and the choice of the response.
#pragma once

#include "contact/raycast.hpp"
#include "contact/reflect.hpp"

namespace clothsim {

inline bool touches(const Contact& contact, const Vec3& position) {
    const double radius = contact.sphere.contact_radius;
    return (position - contact.center).squaredNorm() < radius * radius;
}

inline PointState respond(const Contact& contact, const PointState& point) {
    switch (contact.sphere.response) {
        case Response::reflect: return respond_reflect(contact, point);
        case Response::ray: return respond_ray(contact, point);
        case Response::continuous: break;  // has its own pass over the whole step
    }
    return point;
}

}  // namespace clothsim
