// Light, shadows and pixels.
#include <atomic>
#include <limits>
#include <numbers>

#include "lanes/versions.hpp"
#include "memory/threads.hpp"
#include "picture/visibility.hpp"

namespace clothsim::picture {
namespace {

// Pixels of a tile, along and down, whose 60 kB stay in a second-level cache: at half 4 % slower,
// at twice 2 % faster.
constexpr int tile_width = 32;
constexpr int tile_height = 16;
// Part of the ambient light that a full shadow takes. At 0.25 contact hardly shows, at 1 grid lines
// vanish.
constexpr double ambient_in_shadow = 0.5;
// Cosine; at 0 the slack along the line of sight has no bound.
constexpr double least_facing = 0.05;
constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

double smooth_step(double part) {
    part = std::clamp(part, 0.0, 1.0);
    return part * part * (3 - 2 * part);
}

// Factor of a colour: a light from one side, a light at the eye, and an ambient term that is
// brighter from above. The unit normal faces the eye. `lit` is the visible part of the light, 1
// without shadows.
double light_on(const Shading& shading, const Triple& normal, double to_eye, double lit) {
    const double light =
        (shading.ambient + shading.above * normal[1]) * (1 - ambient_in_shadow * (1 - lit)) +
        shading.eye_light * std::max(to_eye, 0.0);
    return light + shading.key_light * lit * std::max(dot(normal, shading.key), 0.0);
}

// Colour of a cloth at that depth below a surface, of a picture coloured by depth.
Triple penetration_color(const Shading& shading, double depth) {
    const double last = double(shading.depth_colors.size() - 1);
    const double low = shading.depth_range[0];
    const double part_of_range = (depth - low) / (shading.depth_range[1] - low);
    const double place = last * std::min(std::max(0.0, part_of_range), 1.0);
    const std::size_t k = std::size_t(std::min(place, last - 1));
    const double part = place - double(k);
    return (1 - part) * shading.depth_colors[k] + part * shading.depth_colors[k + 1];
}

double depth_below(const Ball& ball, const Triple& point) {
    const Triple way = point - ball.center;
    return ball.solid ? ball.radius - std::sqrt(dot(way, way)) : 0.0;
}
double depth_below(const Plane& plane, const Triple& point) {
    return plane.solid ? dot(plane.point - point, plane.normal) : 0.0;
}

// An array of three numbers a point, at a sample.
Triple blend_corners(const Triple& w, const double* values, const Facet& facet) {
    Triple sum;
    const double *const a = values + 3 * facet.corners[0], *const b = values + 3 * facet.corners[1],
                        *const c = values + 3 * facet.corners[2];
    for (std::size_t k = 0; k < 3; ++k) sum[k] = (w[0] * a[k] + w[1] * b[k]) + w[2] * c[k];
    return sum;
}

// Samples of the shadow map along an edge; at half, contact shadows are jagged.
constexpr int map_size = 512;
// Samples of the map within which heights count as equal: at half, a sheet shades itself in
// stripes.
constexpr double map_slack = 2.5;
// Places of the map that a pixel inspects; at half, wide shadows have bands.
constexpr int taps = 48;
constexpr int taps_of_search = 16;  // of them, those that sample the height of the cover
// Between seeds in the order of places, without a common factor to `taps`.
constexpr int stride = 5;

struct Disc {
    std::array<float, taps> x, y;
};
// A sunflower's seeds, evenly spread over the unit disc, in an order whose first ones are spread as
// well.
Disc seeds() {
    Disc disc;
    const double turn = std::numbers::pi * (3 - std::sqrt(5.0));
    for (std::size_t k = 0; k < taps; ++k) {
        const double radius = std::sqrt((double(k) + 0.5) / taps);
        const double angle = double(k) * turn;
        disc.x[k * stride % taps] = float(radius * std::cos(angle));
        disc.y[k * stride % taps] = float(radius * std::sin(angle));
    }
    return disc;
}
const Disc disc = seeds();

// Extents of a sheet that has a shadow map, whose heights are float32 [m].
constexpr double least_extent = 1e-30;
constexpr double largest_extent = 1e30;

// Metres by which the map is above `height` at the seeds of a disc. Its border is beside the sheet.
// A place that is NaN counts as 0, since `max` returns its first argument then.
CLOTHSIM_VERSIONS void look_up_heights(const float* __restrict map, const Disc& disc, float x,
                                       float y, float radius, float height, int count,
                                       float* __restrict above) {
    const float last = map_size - 1;
    for (int k = 0; k < count; ++k) {
        const float column = std::min(std::max(0.0f, x + radius * disc.x[std::size_t(k)]), last);
        const float row = std::min(std::max(0.0f, y + radius * disc.y[std::size_t(k)]), last);
        above[k] = map[int(row) * map_size + int(column)] - height;
    }
}

// Soft shadows: which part of the light is visible from a point.
class Shadow {
public:
    // Nothing throws a shadow where the shading has none, or the sheet no extent.
    Shadow(const Picture& picture, Poll& poll) : picture_(picture) {
        if (!picture.shading.shadow || !picture.sheet.triangles()) return;
        const Triple up = picture.shading.key, aside{up[1], -up[0], 0};
        const Triple right = (1 / std::sqrt(dot(aside, aside))) * aside;
        view_.axes = {
            right,
            Triple{up[1] * right[2] - up[2] * right[1], up[2] * right[0] - up[0] * right[2],
                   up[0] * right[1] - up[1] * right[0]},
            up};
        std::vector<double> screen(3 * std::size_t(picture.sheet.rows) *
                                   std::size_t(picture.sheet.columns));
        Triple low{HUGE_VAL, HUGE_VAL, HUGE_VAL}, high{-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
        for (std::size_t i = 0; i < screen.size(); ++i) {
            const double* const p = picture.sheet.points + i / 3 * 3;
            screen[i] = dot(view_.axes[i % 3], {p[0], p[1], p[2]});
            low[i % 3] = std::min(low[i % 3], screen[i]);
            high[i % 3] = std::max(high[i % 3], screen[i]);
        }
        const double extent = std::max(high[0] - low[0], high[1] - low[1]);
        const bool usual = extent >= least_extent && extent <= largest_extent;
        if (!usual || !(std::max(high[2], -low[2]) <= largest_extent)) return;
        view_.scale = (map_size - 2) / extent;
        view_.target = view_.to_world({(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, 0.0});
        highest_ = float(high[2]);
        for (std::size_t i = 0; i < screen.size(); i += 3) {
            screen[i] = map_size / 2.0 + view_.scale * (screen[i] - (low[0] + high[0]) / 2);
            screen[i + 1] = map_size / 2.0 - view_.scale * (screen[i + 1] - (low[1] + high[1]) / 2);
        }
        Sheet sheet = picture.sheet;
        sheet.screen = screen.data();
        const Bins bins(sheet, {0, 0, map_size, map_size}, map_size, map_size, poll);
        Nearest nearest(map_size, map_size);
        if (nearest.find(sheet, bins, 0, poll))
            heights_.assign(nearest.nearness.begin(), nearest.nearness.end());
    }

    // Metres above a sheet at which it does not shade itself where the light grazes it.
    double slack() const { return heights_.empty() ? 0.0 : map_slack / view_.scale; }
    // Part of the light that reaches a point, 0 to 1. A ball throws no shadow on itself.
    double lit_part(const Triple& point, const Ball* on = nullptr) const {
        if (!picture_.shading.shadow) return 1;
        double lit = heights_.empty() ? 1.0 : light_past_sheet(point);
        for (const Ball& ball : picture_.balls) {
            if (!ball.solid || &ball == on) continue;
            const Triple way = ball.center - point;
            const double towards = dot(way, picture_.shading.key);
            if (towards <= 0) continue;
            const double beside = std::sqrt(std::max(dot(way, way) - towards * towards, 0.0));
            lit = std::min(
                lit, smooth_step(0.5 + 0.5 * (beside - ball.radius) / (light_size * towards)));
        }
        return lit;
    }

private:
    // First the mean height of the cover between point and light. Then the covered part of a disc
    // as wide as the light's edge seems at that height.
    double light_past_sheet(const Triple& point) const {
        const Triple place = view_.to_view(point);
        const float x = float(map_size / 2.0 + view_.scale * place[0]);
        const float y = float(map_size / 2.0 - view_.scale * place[1]);
        const float slack = float(map_slack / view_.scale);
        const float height = float(place[2]);
        const float edge = float(light_size * view_.scale);
        const float least = float(map_slack);
        const float reach = edge * (highest_ - height) + least;
        constexpr float middle = map_size / 2.0f;
        const float away = std::max(std::abs(x - middle), std::abs(y - middle));
        if (highest_ <= height + slack || !(away - reach <= middle)) return 1;
        float above[taps], sum = 0, between = 0, covered = 0;
        look_up_heights(heights_.data(), disc, x, y, reach, height, taps_of_search, above);
        for (int k = 0; k < taps_of_search; ++k)
            if (above[k] > slack) sum += above[k], ++between;
        if (between == 0) return 1;
        const float width = std::max(edge * (sum / between), least);
        look_up_heights(heights_.data(), disc, x, y, width, height, taps, above);
        for (const float gap : above) covered += std::clamp(gap / slack - 1, 0.0f, 1.0f);
        return 1 - double(covered) / taps;
    }

    const Picture& picture_;
    View view_;  // from the light
    std::vector<float> heights_;  // the map: of the sheet, -infinity beside it
    float highest_ = 0;  // of the map [m]
};

class Tile {
public:
    Tile(const Picture& picture, const Bins& bins, const Shadow& shadow)
        : picture_(picture),
          view_(picture.view),
          shading_(picture.shading),
          bins_(bins),
          shadow_(shadow),
          nearest_(tile_width * samples, tile_height * samples),
          color_(nearest_.nearness.size()) {
        for (const Ball& ball : picture.balls) boxes_.push_back(sample_box_of(ball));
    }

    // Draw the tile of that number into the picture's pixels. Whether it has come to its end.
    bool draw_tile(int number, Poll& poll, std::uint8_t* pixels) {
        box_ = bins_.tile(number);
        if (!nearest_.find(picture_.sheet, bins_, number, poll)) return false;
        std::fill(color_.begin(), color_.end(), to_bytes(shading_.background));
        if (!nearest_.facets.empty()) each_pixel(box_, [&](int x, int y) { paint_sheet(x, y); });
        for (std::size_t k = 0; k < boxes_.size(); ++k) {
            const Box& of = boxes_[k];
            each_pixel(clipped(of.left, of.top, of.right, of.bottom, box_),
                       [&](int x, int y) { paint_ball(picture_.balls[k], x, y); });
        }
        for (const Plane& plane : picture_.planes) paint_plane(plane);
        write_pixels(pixels);
        return true;
    }

private:
    static std::array<float, 3> to_bytes(const Triple& color) {
        return {float(color[0]), float(color[1]), float(color[2])};
    }
    template <class Paint>
    void each_pixel(const Box& box, Paint paint) const {
        for (int y = box.top / samples; y * samples < box.bottom; ++y)
            for (int x = box.left / samples; x * samples < box.right; ++x) paint(x, y);
    }
    template <class Paint>
    void each_sample(int x, int y, Paint paint) const {
        for (int row = y * samples; row < (y + 1) * samples; ++row)
            for (int column = x * samples; column < (x + 1) * samples; ++column)
                paint(nearest_.at(box_, column, row), column, row);
    }
    // The samples that a ball may cover.
    Box sample_box_of(const Ball& ball) const {
        const Box whole{0, 0, view_.columns(), view_.rows()};
        const Triple center = view_.to_view(ball.center);
        const double ahead = view_.distance - center[2];
        if (view_.perspective() && ahead <= ball.radius) return whole;
        // Ends of the cube around the ball, as far away as its near or its far side.
        const auto end = [&](double place, double sign) {
            const double side = place + sign * ball.radius;
            const double away = sign * side > 0 ? ahead - ball.radius : ahead + ball.radius;
            return view_.scale * side * (view_.perspective() ? view_.distance / away : 1.0);
        };
        return clipped(0.5 * view_.columns() + end(center[0], -1),
                       0.5 * view_.rows() - end(center[1], 1),
                       0.5 * view_.columns() + end(center[0], 1),
                       0.5 * view_.rows() - end(center[1], -1), whole);
    }

    Triple corner_weights(const Facet& facet, int column, int row) const {
        const double x = column + 0.5 - facet.x;
        const double y = row + 0.5 - facet.y;
        const double b = facet.b(x, y);
        const double c = facet.c(x, y);
        if (!view_.perspective()) return {1.0 - b - c, b, c};
        // A function linear on the sheet is linear in the picture after division by the distance.
        const Triple w{(1.0 - b - c) * facet.nearness, b * (facet.nearness + facet.b_nearness),
                       c * (facet.nearness + facet.c_nearness)};
        return (1 / ((w[0] + w[1]) + w[2])) * w;
    }

    void paint_sheet(int x, int y) {
        const Sheet& sheet = picture_.sheet;
        double lit = unknown;  // one for a pixel, since shadows are soft
        each_sample(x, y, [&](std::size_t i, int column, int row) {
            if (nearest_.facet[i] < 0) return;
            const Facet& facet = nearest_.facets[std::size_t(nearest_.facet[i])];
            const Triple w = corner_weights(facet, column, row),
                         to_eye = view_.ray(column + 0.5, row + 0.5).to_eye;
            const Triple point = blend_corners(w, sheet.points, facet);
            Triple normal = blend_corners(w, sheet.normals, facet);
            const double facing = dot(normal, to_eye);
            const double side = facing >= 0 ? 1.0 : -1.0;
            const double factor = side / std::max(std::sqrt(dot(normal, normal)), 1e-300);
            normal = factor * normal;
            Triple color = side > 0 ? shading_.front : shading_.back;
            if (sheet.colors) color = blend_corners(w, sheet.colors, facet);
            if (!shading_.depth_colors.empty()) {
                double depth = 0;
                for (const Ball& ball : picture_.balls)
                    depth = std::max(depth, depth_below(ball, point));
                for (const Plane& plane : picture_.planes)
                    depth = std::max(depth, depth_below(plane, point));
                color = penetration_color(shading_, depth);
            }
            if (std::isnan(lit)) lit = shadow_.lit_part(point + shadow_.slack() * normal);
            const auto near = [&](double part) {  // to a line of the grid, in cells
                return part < shading_.grid_line || part > 1 - shading_.grid_line;
            };
            // Two of a triangle's weights are places along and down its cell.
            const bool line = facet.lower ? near(w[0]) || near(w[1]) : near(w[1]) || near(w[2]);
            const double light = light_on(shading_, normal, factor * facing, lit);
            color_[i] = to_bytes(((line ? shading_.grid_shade : 1.0) * light) * color);
        });
    }

    // The colour of a body's surface at a sample, with the cloth that lies below it.
    template <class Body>
    Triple color_with_cloth_below(const Triple& color, const Body& body, std::size_t sample,
                                  int column, int row) const {
        if (!body.solid || nearest_.facet[sample] < 0) return color;
        const Facet& facet = nearest_.facets[std::size_t(nearest_.facet[sample])];
        const Triple point =
            blend_corners(corner_weights(facet, column, row), picture_.sheet.points, facet);
        const double under = depth_below(body, point) - view_.slack();
        if (!(under > 0)) return color;
        if (!shading_.depth_colors.empty()) return penetration_color(shading_, under);
        const double red = shading_.least_red +
            (1 - shading_.least_red) * std::min(under / shading_.full_red_depth, 1.0);
        return (1 - red) * color + red * shading_.penetration;
    }

    void paint_ball(const Ball& ball, int x, int y) {
        const double ahead = view_.distance - view_.to_view(ball.center)[2];
        const double middle = view_.perspective() ? 1 / ahead : -ahead;  // nearness of the centre
        double lit = unknown;
        each_sample(x, y, [&](std::size_t i, int column, int row) {
            const Ray ray = view_.ray(column + 0.5, row + 0.5);
            const Triple from = ray.start - ball.center;
            const double b = dot(ray.to_eye, from);
            const double root = b * b - dot(from, from) + ball.radius * ball.radius;
            if (!(root > 0)) return;
            const double way = b - std::sqrt(root);
            if (view_.perspective() && way <= 0) return;
            const Triple normal = (1 / ball.radius) * (ray.at(way) - ball.center);
            const double facing = dot(normal, ray.to_eye);
            const double nearness =
                view_.nearness(ray, way + view_.slack() / std::max(facing, least_facing));
            if (!(nearness > nearest_.nearness[i])) return;
            if (std::isnan(lit)) lit = shadow_.lit_part(ball.center + ball.radius * normal, &ball);
            const Triple color = light_on(shading_, normal, facing, lit) * ball.color;
            // Cloth in the far half of the ball is not what the eye sees.
            color_[i] = to_bytes(nearest_.nearness[i] < middle
                                     ? color
                                     : color_with_cloth_below(color, ball, i, column, row));
            nearest_.nearness[i] = nearness;
        });
    }

    // Brightness of a plane over that of a level one.
    double brightness_of_plane(const Triple& normal) const {
        const double level = light_on(shading_, {0.0, 1.0, 0.0}, 0.0, 1.0);
        return 1 - plane_tone * (1 - light_on(shading_, normal, 0.0, 1.0) / level);
    }

    // Part of a pixel that lines of a plane's grid cover. A line has at least half a pixel; where
    // cells have few pixels, lines fade. Every tenth line stays to ten times as far.
    double grid_line_part(const Plane& plane, const Triple& point, const Triple& to_right,
                          const Triple& to_up) const {
        double most = 0;
        for (const Triple& across : plane.lines) {
            const double pixel = std::abs(dot(to_right, across)) + std::abs(dot(to_up, across));
            const double place = dot(point - plane.node, across);
            const double half_line = std::max(shading_.plane_line, 0.25 * pixel);
            for (const double cell : {shading_.plane_cell, 10 * shading_.plane_cell}) {
                const double away = std::abs(place - cell * std::round(place / cell));
                const double part = (half_line + 0.5 * pixel - away) / pixel;
                const double fade = 1.5 - 5 * pixel / cell;
                // A NaN, of a pixel on the horizon, becomes 0.
                most = std::max(
                    most, std::min(std::max(0.0, part), 1.0) * std::min(std::max(0.0, fade), 1.0));
            }
        }
        return most;
    }

    void paint_plane(const Plane& plane) {
        // Nearness is linear in the picture. The plane is lower by the slack, as balls are.
        const Triple n{dot(view_.axes[0], plane.normal), dot(view_.axes[1], plane.normal),
                       dot(view_.axes[2], plane.normal)};
        const double height = dot(plane.point - view_.target, plane.normal) - view_.slack();
        // The eye lies so far above the plane; far away only the direction counts.
        const double above = view_.perspective() ? n[2] * view_.distance - height : n[2];
        if (!(above > 0)) return;
        const double length = view_.perspective() ? view_.distance : 1.0;
        const double middle = view_.perspective() ? n[2] / above : height / above;
        const double by_x = -n[0] / (length * above);
        const double by_y = -n[1] / (length * above);
        const double metre = 1 / view_.scale;
        const double pixel = metre * samples;
        const double left = 0.5 * view_.columns();
        const double top = 0.5 * view_.rows();
        // The place that is seen, by metres to the right and up in the plane through the target.
        const auto place_at = [&](double right, double up) {
            const double nearness = middle + by_x * right + by_y * up;
            const double away = view_.perspective() ? 1 / nearness : length;
            return view_.target +
                view_.to_world({away / length * right, away / length * up,
                                view_.perspective() ? length - away : nearness});
        };
        const double tone = brightness_of_plane(plane.normal);
        const bool grid = dot(plane.lines[0], plane.lines[0]) > 0;
        each_pixel(box_, [&](int x, int y) {
            double lit = unknown;
            Triple color = shading_.background;
            each_sample(x, y, [&](std::size_t i, int column, int row) {
                const double right = metre * (column + 0.5 - left);
                const double up = metre * (top - row - 0.5);
                const double nearness = middle + by_x * right + by_y * up;
                if (!(nearness > nearest_.nearness[i])) return;
                if (view_.perspective() && nearness <= 0) return;
                if (std::isnan(lit)) {
                    const Triple point = place_at(right, up);
                    const Triple way = point - plane.point;
                    const double drawn =
                        smooth_step(2 * (1 - std::sqrt(dot(way, way)) / plane.radius));
                    lit = drawn > 0 ? shadow_.lit_part(point) : 1.0;
                    double shade = tone * (1 - (1 - plane_in_shadow) * (1 - lit));
                    if (grid && drawn > 0)
                        shade *= 1 -
                            (1 - shading_.plane_shade) *
                                grid_line_part(plane, point, place_at(right + pixel, up) - point,
                                               place_at(right, up + pixel) - point);
                    color = (shade * drawn) * plane.color + (1 - drawn) * shading_.background;
                }
                color_[i] = to_bytes(color_with_cloth_below(color, plane, i, column, row));
                nearest_.nearness[i] = nearness;
            });
        });
    }

    // The mean of a pixel's samples.
    void write_pixels(std::uint8_t* pixels) const {
        const float factor = 255.0f / float(samples * samples);
        each_pixel(box_, [&](int x, int y) {
            std::array<float, 3> sum{};
            each_sample(x, y, [&](std::size_t i, int, int) {
                for (std::size_t k = 0; k < 3; ++k) sum[k] += color_[i][k];
            });
            for (std::size_t k = 0; k < 3; ++k)
                pixels[3 * (std::size_t(y) * std::size_t(view_.width) + std::size_t(x)) + k] =
                    std::uint8_t(std::lrint(std::min(std::max(0.0f, factor * sum[k]), 255.0f)));
        });
    }

    const Picture& picture_;
    const View& view_;
    const Shading& shading_;
    const Bins& bins_;
    const Shadow& shadow_;
    std::vector<Box> boxes_;  // of the balls
    Nearest nearest_;
    Box box_;
    std::vector<std::array<float, 3>> color_;
};

}  // namespace

bool render(const Picture& picture, int threads, const std::function<bool()>& interrupted,
            std::uint8_t* pixels) {
    const View& view = picture.view;
    Poll poll(interrupted);
    const Bins bins(picture.sheet, {0, 0, view.columns(), view.rows()}, tile_width * samples,
                    tile_height * samples, poll);
    const Shadow shadow(picture, poll);
    if (poll.stopped()) return false;
    std::vector<Tile> tiles(std::size_t(threads), Tile(picture, bins, shadow));
    std::atomic<int> next{0};
    run_in_team(threads, [&](int thread, int) {
        Tile& tile = tiles[std::size_t(thread)];
        for (int n = next++; n < bins.count() && tile.draw_tile(n, poll, pixels); n = next++)
            continue;
    });
    return !poll.stopped();
}

}  // namespace clothsim::picture
