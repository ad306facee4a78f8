#include "picture/disc.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace clothsim::picture {
namespace {

constexpr double least_facing = 0.05;  // cosine; at 0 the slack along the line of sight has no bound

// Tangents of the angles between which the eye sees a circle of that radius, `ahead` of it and `aside`.
std::pair<double, double> seen_between(double aside, double ahead, double radius) {
    const double away = std::sqrt(aside * aside + ahead * ahead);
    if (away <= radius) return {-HUGE_VAL, HUGE_VAL};  // the eye is inside
    const double middle = std::atan2(aside, ahead), half = std::asin(radius / away),
                 right = std::numbers::pi / 2;
    return {middle - half <= -right ? -HUGE_VAL : std::tan(middle - half),
            middle + half >= right ? HUGE_VAL : std::tan(middle + half)};
}

}  // namespace

Ray ray(const View& view, int column, int row) {
    const double x = (column + 0.5 - 0.5 * view.columns()) / view.scale;
    const double y = (0.5 * view.rows() - row - 0.5) / view.scale;
    if (!view.perspective()) return {x, y, view.axes[2]};
    const double length = std::sqrt(x * x + y * y + view.distance * view.distance);
    return {x, y, (1 / length) * view.to_world({-x, -y, view.distance})};
}

Disc::Disc(const View& view, const Triple& center, double radius)
    : view_(view), center_(center), radius_(radius), slack_(view.slack()) {
    const double columns = view.columns(), rows = view.rows();
    x_ = columns / 2 + view.scale * center[0];
    y_ = rows / 2 - view.scale * center[1];
    reach_ = view.scale * radius;
    nearness = center[2];
    double left = x_ - reach_, right = x_ + reach_, top = y_ - reach_, bottom = y_ + reach_;
    if (view.perspective()) {
        const double ahead = view.distance - center[2], sample = view.scale * view.distance;
        nearness = 1 / ahead;
        if (ahead <= -radius) right = left;  // behind the eye
        const auto [low_x, high_x] = seen_between(center[0], ahead, radius);
        const auto [low_y, high_y] = seen_between(center[1], ahead, radius);
        left = columns / 2 + sample * low_x, right = columns / 2 + sample * high_x;
        top = rows / 2 - sample * high_y, bottom = rows / 2 - sample * low_y;
        if (ahead <= -radius) left = right = 0;
    }
    box = {int(std::clamp(left, 0.0, columns)), int(std::clamp(top, 0.0, rows)),
           int(std::clamp(right + 1, 0.0, columns)), int(std::clamp(bottom + 1, 0.0, rows))};
}

bool Disc::hit(int column, int row, double& found, Triple& normal) const {
    if (view_.perspective()) return hit_in_perspective(column, row, found, normal);
    const double u = (column + 0.5 - x_) / reach_, v = (y_ - row - 0.5) / reach_;
    const double inside = 1.0 - u * u - v * v;
    if (!(inside > 0)) return false;
    const double half = std::sqrt(inside);
    found = center_[2] + radius_ * half - slack_ / std::max(half, least_facing);
    normal = {u, v, half};
    return true;
}

// The eye is at (0, 0, distance), and k times the way from there to the plane through the target leads to the
// sphere.
bool Disc::hit_in_perspective(int column, int row, double& found, Triple& normal) const {
    const Ray to = ray(view_, column, row);
    const Triple way{to.x, to.y, -view_.distance}, eye{0, 0, view_.distance}, from = eye - center_;
    const double a = dot(way, way), b = dot(way, from), c = dot(from, from) - radius_ * radius_;
    const double root = b * b - a * c;
    if (!(root > 0)) return false;
    const double k = (-b - std::sqrt(root)) / a;
    if (!(k > 0)) return false;
    normal = (1 / radius_) * (from + k * way);
    const double facing = std::max(-dot(normal, way), least_facing * std::sqrt(a));
    found = 1 / ((k + slack_ / facing) * view_.distance);
    return true;
}

}  // namespace clothsim::picture
