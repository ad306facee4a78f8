#include "picture/tile.hpp"

#include <algorithm>
#include <cmath>

#include "memory/versions.hpp"
#include "picture/light.hpp"

namespace clothsim::picture {
namespace {

// Factor of the ground's colour in full shadow. At half the ground outshines the cloth's own shadows, at
// twice no shadow is left.
constexpr double ground_in_shadow = 0.7;

struct Lit {
    const double *nx, *ny, *nz, *ex, *ey, *ez, *lit;
};

// The light on `count` samples whose normals are turned towards the eye. `front` has the sign of the face
// that is seen.
CLOTHSIM_VERSIONS void light_samples(const Shading& shading, const Lit& at, int count,
                                     double* __restrict light, double* __restrict front) {
    for (int k = 0; k < count; ++k) {
        const double facing = (at.nx[k] * at.ex[k] + at.ny[k] * at.ey[k]) + at.nz[k] * at.ez[k];
        const double side = facing >= 0 ? 1.0 : -1.0;
        front[k] = side;
        light[k] = light_on(shading, side * at.nx[k], side * at.ny[k], side * at.nz[k], at.ex[k], at.ey[k],
                            at.ez[k], at.lit[k]);
    }
}

}  // namespace

Tile::Tile(const Picture& picture, const Bins& bins, const Shadow& shadow)
    : picture_(picture),
      bins_(bins),
      shadow_(shadow),
      perspective_(picture.view.perspective()),
      nearest_(tile_width * picture.view.samples, tile_height * picture.view.samples, bins.most()) {
    for (const Ball& ball : picture.balls)
        discs_.emplace_back(picture.view, picture.view.to_view(ball.center), ball.radius);
    for (std::vector<float>& plane : color_) plane.resize(nearest_.nearness.size());
    const std::size_t width = std::size_t(nearest_.width);
    for (int k = 0; k < 3; ++k) {
        normal_[k].resize(width);
        base_[k].resize(width);
        to_eye_[k].assign(width, picture.view.axes[2][std::size_t(k)]);
    }
    lit_.assign(width, 1.0);
    grid_.resize(width);
    light_.resize(width);
    front_.resize(width);
}

bool Tile::draw(int number, Poll& poll, std::uint8_t* pixels) {
    box_ = bins_.tile(number);
    if (poll.stopped()) return false;  // also in tiles without cloth, where `find` does not ask
    if (!nearest_.find(picture_.sheet, bins_, number, poll)) return false;
    for (int k = 0; k < 3; ++k)
        std::fill(color_[k].begin(), color_[k].end(), float(picture_.shading.background[std::size_t(k)]));
    if (!nearest_.facets.empty())
        for (int row = box_.top; row < box_.bottom; ++row) paint_row(row);
    for (std::size_t k = 0; k < discs_.size(); ++k) paint_ball(picture_.balls[k], discs_[k]);
    if (picture_.ground.drawn) paint_ground();
    store(pixels);
    return true;
}

Triple Tile::weights(const Facet& facet, int column, int row) const {
    const double x = facet.x + (column - facet.box.left), y = facet.y + (row - facet.box.top);
    const double b = facet.b(x, y), c = facet.c(x, y);
    Triple w{1.0 - b - c, b, c};
    if (!perspective_) return w;
    // A function linear on the sheet is linear in the picture after division by the distance.
    w = {w[0] * facet.nearness, b * (facet.nearness + facet.b_nearness),
         c * (facet.nearness + facet.c_nearness)};
    return (1 / ((w[0] + w[1]) + w[2])) * w;
}

// An array of three numbers a point, at a sample.
static Triple blend(const Triple& w, const double* values, const Facet& facet) {
    Triple sum;
    const double *const a = values + 3 * facet.corners[0], *const b = values + 3 * facet.corners[1],
                        *const c = values + 3 * facet.corners[2];
    for (std::size_t k = 0; k < 3; ++k) sum[k] = (w[0] * a[k] + w[1] * b[k]) + w[2] * c[k];
    return sum;
}

void Tile::paint_row(int row) {
    const std::size_t start = at(box_.left, row);
    const double* const facets = &nearest_.facet[start];
    const int count = box_.right - box_.left;
    int first = count, last = 0;
    for (int k = 0; k < count;) {
        const double number = facets[k];
        const int begin = k;
        while (k < count && facets[k] == number) ++k;
        if (number < 0) continue;
        gather(nearest_.facets[std::size_t(number)], row, begin, k);
        first = std::min(first, begin);
        last = k;
    }
    if (first >= last) return;
    const Shading& shading = picture_.shading;
    const Lit lit{&normal_[0][0], &normal_[1][0], &normal_[2][0], &to_eye_[0][0],
                  &to_eye_[1][0], &to_eye_[2][0], &lit_[0]};
    light_samples(shading, lit, last, light_.data(), front_.data());
    for (int k = 0; k < 3; ++k) {
        const double front = shading.front[std::size_t(k)], back = shading.back[std::size_t(k)];
        float* const color = &color_[k][start];
        for (int i = first; i < last; ++i) {
            const double base = picture_.sheet.colors ? base_[k][std::size_t(i)]
                : front_[std::size_t(i)] > 0          ? front
                                                      : back;
            if (facets[i] >= 0) color[i] = float(grid_[std::size_t(i)] * base * light_[std::size_t(i)]);
        }
    }
}

// The sheet at the samples [first, last) of a tile's row, which one facet covers.
void Tile::gather(const Facet& facet, int row, int first, int last) {
    const Picture& p = picture_;
    const std::int64_t columns = p.sheet.columns;
    double cell[3][2];
    for (std::size_t k = 0; k < 3; ++k) {
        const std::int64_t corner_row = facet.corners[k] / columns;
        cell[k][0] = double(corner_row);
        cell[k][1] = double(facet.corners[k] % columns);
    }
    const double low_row = std::min({cell[0][0], cell[1][0], cell[2][0]});
    const double low_column = std::min({cell[0][1], cell[1][1], cell[2][1]});
    const double* const a = p.sheet.normals + 3 * facet.corners[0];
    const double* const b = p.sheet.normals + 3 * facet.corners[1];
    const double* const c = p.sheet.normals + 3 * facet.corners[2];
    const auto near = [&](double place, double line) {
        return (std::abs(place - line) < p.shading.grid_line) |
            (std::abs(place - (line + 1)) < p.shading.grid_line);
    };
    for (int k = first; k < last; ++k) {
        const Triple w = weights(facet, box_.left + k, row);
        const std::size_t i = std::size_t(k);
        for (std::size_t n = 0; n < 3; ++n) normal_[n][i] = (w[0] * a[n] + w[1] * b[n]) + w[2] * c[n];
        const double at_row = (w[0] * cell[0][0] + w[1] * cell[1][0]) + w[2] * cell[2][0];
        const double at_column = (w[0] * cell[0][1] + w[1] * cell[1][1]) + w[2] * cell[2][1];
        grid_[i] = near(at_row, low_row) | near(at_column, low_column) ? p.shading.grid_shade : 1.0;
    }
    for (int k = first; k < last && (perspective_ || p.shading.shadow || p.sheet.colors); ++k) {
        const std::size_t i = std::size_t(k);
        const Triple w = weights(facet, box_.left + k, row),
                     color = p.sheet.colors ? blend(w, p.sheet.colors, facet) : w;
        const Triple to_eye = ray(p.view, box_.left + k, row).to_eye;
        for (std::size_t n = 0; n < 3; ++n) {
            base_[n][i] = color[n];
            to_eye_[n][i] = to_eye[n];
        }
        if (p.shading.shadow) lit_[i] = shadow_.lit(blend(w, p.sheet.points, facet), k, row);
    }
}

void Tile::paint_ball(const Ball& ball, const Disc& disc) {
    const View& view = picture_.view;
    const Box box = intersection(disc.box, box_);
    for (int row = box.top; row < box.bottom; ++row)
        for (int column = box.left; column < box.right; ++column) {
            const std::size_t i = at(column, row);
            Triple normal;
            double nearness;
            if (!disc.hit(column, row, nearness, normal) || nearness <= nearest_.nearness[i]) continue;
            normal = view.to_world(normal);
            const Triple to_eye = ray(view, column, row).to_eye;
            const double lit = picture_.shading.shadow
                ? shadow_.lit(ball.center + ball.radius * normal, column, row, &ball)
                : 1.0;
            const double light = light_on(picture_.shading, normal[0], normal[1], normal[2], to_eye[0],
                                          to_eye[1], to_eye[2], lit);
            const double red =
                ball.solid ? red_of(picture_.shading, depth_below(ball, disc, column, row)) : 0.0;
            for (std::size_t k = 0; k < 3; ++k)
                color_[k][i] =
                    float(ball.color[k] * light * (1 - red) + picture_.shading.penetration[k] * red);
            nearest_.nearness[i] = nearness;
        }
}

// Depth of the sheet below the ball's surface at a sample [m]. Cloth on the far half of the ball is not what
// the eye sees.
double Tile::depth_below(const Ball& ball, const Disc& disc, int column, int row) const {
    const std::size_t i = at(column, row);
    if (nearest_.facet[i] < 0 || nearest_.nearness[i] < disc.nearness) return 0;
    const Facet& facet = nearest_.facets[std::size_t(nearest_.facet[i])];
    Triple way = blend(weights(facet, column, row), picture_.sheet.points, facet);
    way = way - ball.center;
    return ball.radius - std::sqrt(dot(way, way)) - picture_.view.slack();
}

void Tile::paint_ground() {
    const View& view = picture_.view;
    const Ground& ground = picture_.ground;
    for (int row = box_.top; row < box_.bottom; ++row)
        for (int column = box_.left; column < box_.right; ++column) {
            const Ray ray = picture::ray(view, column, row);
            if (ray.to_eye[1] <= 0) continue;  // the eye is below it
            const Triple start = view.target + view.to_world({ray.x, ray.y, 0.0});
            const double way = (ground.height - start[1]) / ray.to_eye[1];
            const Triple point = start + way * ray.to_eye;
            const double nearer = dot(view.axes[2], way * ray.to_eye) - view.slack();
            const double nearness = perspective_ ? 1 / (view.distance - nearer) : nearer;
            const std::size_t i = at(column, row);
            if (perspective_ && nearness <= 0) continue;
            if (nearness <= nearest_.nearness[i]) continue;
            const double far = std::sqrt(dot(point - ground.middle, point - ground.middle)) / ground.radius;
            const double part = std::clamp(2 * (1 - far), 0.0, 1.0), drawn = part * part * (3 - 2 * part);
            const double lit = picture_.shading.shadow && drawn > 0 ? shadow_.lit(point, column, row) : 1.0;
            const double shade = 1 - (1 - ground_in_shadow) * (1 - lit);
            for (std::size_t k = 0; k < 3; ++k) {
                const double background = picture_.shading.background[k];
                color_[k][i] = float(background + drawn * (picture_.shading.ground[k] * shade - background));
            }
        }
}

// The mean of a pixel's samples, in the order of its rows.
void Tile::store(std::uint8_t* pixels) const {
    const int samples = picture_.view.samples, columns = (box_.right - box_.left) / samples;
    const float factor = float(255.0 / (samples * samples));
    float sum[tile_width];
    for (int row = box_.top / samples; row < box_.bottom / samples; ++row) {
        std::uint8_t* const out =
            pixels + 3 * (std::ptrdiff_t(row) * picture_.view.width + box_.left / samples);
        for (int k = 0; k < 3; ++k) {
            std::fill_n(sum, columns, 0.0f);
            for (int i = 0; i < samples; ++i)
                for (int j = 0; j < samples; ++j) {
                    const float* const color = &color_[k][at(box_.left, row * samples + i)] + j;
                    for (int n = 0; n < columns; ++n) sum[n] += color[n * samples];
                }
            for (int n = 0; n < columns; ++n)
                out[3 * n + k] = std::uint8_t(std::lrint(std::clamp(factor * sum[n], 0.0f, 255.0f)));
        }
    }
}

}  // namespace clothsim::picture
