#include "picture/shadow.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "picture/visibility.hpp"

namespace clothsim::picture {
namespace {

// Samples of the map, along and down: 2 ms, 2 mm of a sheet of 1 m. At half, edges of contact shadows are
// jagged; twice takes four times as long and appears the same.
constexpr int map_size = 512;
// Tangent of the angle at which a point sees the light's radius. At half, shadows have hard edges; at twice,
// the shadow of a sheet 0.5 m above the ground has no dark core.
constexpr double light_size = 0.15;
// Samples of the map within which heights count as equal, since facets are flat and the map's samples are not
// points. At half, a sheet shades itself in stripes; at twice, contact shadows begin 10 mm beside the
// contact.
constexpr double map_slack = 2.5;
// Places of the map that a sample inspects. At half, bands show in wide shadows; twice takes twice the time.
constexpr int taps = 24;

// Every second ray samples the height of the cover. At half a picture takes a third longer and appears the
// same. At twice it takes 5 % less, and 0.5 % of the values change by more than 3 of 255.
constexpr int taps_per_search = 2;

struct Place {
    double x, y;
};
// A sunflower's seeds, evenly spread over the unit disc. Neighbouring samples take every fourth, so that the
// samples of a pixel inspect them all.
std::array<std::array<Place, taps>, 4> seeds() {
    std::array<std::array<Place, taps>, 4> places;
    const double turn = std::numbers::pi * (3 - std::sqrt(5.0));
    for (int k = 0; k < 4 * taps; ++k) {
        const double radius = std::sqrt((k + 0.5) / (4 * taps));
        places[std::size_t(k % 4)][std::size_t(k / 4)] = {radius * std::cos(k * turn),
                                                          radius * std::sin(k * turn)};
    }
    return places;
}
const std::array<std::array<Place, taps>, 4> discs = seeds();

}  // namespace

Shadow::Shadow(const Picture& picture, Poll& poll) : picture_(picture) {
    if (!picture.shading.shadow || !picture.sheet.triangles()) return;
    const Triple up = picture.shading.key, aside{up[1], -up[0], 0};
    const Triple right = (1 / std::sqrt(dot(aside, aside))) * aside;
    view_.axes = {right,
                  Triple{up[1] * right[2] - up[2] * right[1], up[2] * right[0] - up[0] * right[2],
                         up[0] * right[1] - up[1] * right[0]},
                  up};
    const std::size_t points = std::size_t(picture.sheet.rows) * std::size_t(picture.sheet.columns);
    std::vector<double> screen(3 * points);
    Triple low{HUGE_VAL, HUGE_VAL, HUGE_VAL}, high{-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
    for (std::size_t i = 0; i < points; ++i) {
        const double* const p = picture.sheet.points + 3 * i;
        const Triple seen = view_.to_view({p[0], p[1], p[2]});
        for (std::size_t k = 0; k < 3; ++k) {
            screen[3 * i + k] = seen[k];
            low[k] = std::min(low[k], seen[k]);
            high[k] = std::max(high[k], seen[k]);
        }
    }
    const double extent = std::max({high[0] - low[0], high[1] - low[1], 1e-300});
    view_.width = view_.height = map_size;
    view_.scale = (map_size - 2) / extent;
    view_.target = view_.to_world({(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, 0.0});
    highest_ = high[2];
    for (std::size_t i = 0; i < points; ++i) {
        screen[3 * i] = map_size / 2.0 + view_.scale * (screen[3 * i] - (low[0] + high[0]) / 2);
        screen[3 * i + 1] = map_size / 2.0 - view_.scale * (screen[3 * i + 1] - (low[1] + high[1]) / 2);
    }
    Sheet sheet = picture.sheet;
    sheet.screen = screen.data();
    const Bins bins(sheet, map_size, map_size, map_size, map_size, poll);
    Nearest nearest(map_size, map_size, bins.most());
    if (nearest.find(sheet, bins, 0, poll)) nearness_ = std::move(nearest.nearness);
}

double Shadow::lit(const Triple& point, int column, int row, const Ball* on) const {
    double lit = nearness_.empty() ? 1.0 : past_sheet(point, 2 * (row % 2) + column % 2);
    for (const Ball& ball : picture_.balls) {
        if (!ball.solid || &ball == on) continue;
        const Triple way = ball.center - point;
        const double towards = dot(way, picture_.shading.key);
        if (towards <= 0) continue;
        const double beside = std::sqrt(std::max(dot(way, way) - towards * towards, 0.0));
        const double edge = light_size * towards;
        const double part = std::clamp(0.5 + 0.5 * (beside - ball.radius) / edge, 0.0, 1.0);
        lit = std::min(lit, part * part * (3 - 2 * part));
    }
    return lit;
}

double Shadow::above(double x, double y, double height) const {
    if (!(x >= 0 && y >= 0 && x < map_size && y < map_size)) return -HUGE_VAL;
    return nearness_[std::size_t(y) * map_size + std::size_t(x)] - height;
}

// First the mean height of the cover between point and light. Then the covered part of a disc as wide as the
// light's edge seems at that height.
double Shadow::past_sheet(const Triple& point, int which) const {
    const std::array<Place, taps>& disc = discs[std::size_t(which)];
    const Triple seen = view_.to_view(point);
    const double x = map_size / 2.0 + view_.scale * seen[0], y = map_size / 2.0 - view_.scale * seen[1];
    const double slack = map_slack / view_.scale,
                 reach = light_size * (highest_ - seen[2]) * view_.scale + map_slack;
    if (highest_ <= seen[2] + slack) return 1;
    double sum = 0;
    int between = 0;
    for (int k = 0; k < taps; k += taps_per_search) {
        const Place& place = disc[std::size_t(k)];
        const double height = above(x + reach * place.x, y + reach * place.y, seen[2]);
        if (height > slack) sum += height, ++between;
    }
    if (!between) return 1;
    const double width = std::max(light_size * (sum / between) * view_.scale, map_slack);
    double covered = 0;
    for (const auto& [dx, dy] : disc)
        covered += std::clamp(above(x + width * dx, y + width * dy, seen[2]) / slack - 1, 0.0, 1.0);
    return 1 - covered / taps;
}

}  // namespace clothsim::picture
