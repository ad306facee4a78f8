#include "picture/visibility.hpp"

#include "memory/versions.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace clothsim::picture {
namespace {

// Triangles between two questions of a loop whether it is to end: some 30 us. At half, questions take 1 % of
// the time; at twice, nothing is late yet.
constexpr std::int64_t triangles_between_questions = 1024;

}  // namespace

Box intersection(const Box& a, const Box& b) {
    return {std::max(a.left, b.left), std::max(a.top, b.top), std::min(a.right, b.right),
            std::min(a.bottom, b.bottom)};
}

Box box_of(const Sheet& sheet, std::int64_t triangle, int columns, int rows) {
    const std::array<std::int64_t, 3> corners = sheet.corners(triangle);
    const double* const a = sheet.screen + 3 * corners[0];
    const double* const b = sheet.screen + 3 * corners[1];
    const double* const c = sheet.screen + 3 * corners[2];
    for (int k = 0; k < 3; ++k)
        if (!std::isfinite(a[k] + b[k] + c[k])) return {};
    const auto low = [&](int k, int limit) {
        return int(std::clamp(std::floor(std::min({a[k], b[k], c[k]})), 0.0, double(limit)));
    };
    const auto high = [&](int k, int limit) {
        return int(std::clamp(std::ceil(std::max({a[k], b[k], c[k]})), 0.0, double(limit)));
    };
    return {low(0, columns), low(1, rows), high(0, columns), high(1, rows)};
}

Facet facet_of(const Sheet& sheet, std::int64_t triangle, const Box& box) {
    const std::array<std::int64_t, 3> corners = sheet.corners(triangle);
    const double* const a = sheet.screen + 3 * corners[0];
    const double* const b = sheet.screen + 3 * corners[1];
    const double* const c = sheet.screen + 3 * corners[2];
    const double bx = b[0] - a[0], by = b[1] - a[1], cx = c[0] - a[0], cy = c[1] - a[1];
    const double twice_area = bx * cy - by * cx;
    // Of a triangle without area every weight is NaN or infinite, so that it covers nothing.
    return {corners,
            box,
            box.left + 0.5 - a[0],
            box.top + 0.5 - a[1],
            cy / twice_area,
            -cx / twice_area,
            -by / twice_area,
            bx / twice_area,
            a[2],
            b[2] - a[2],
            c[2] - a[2]};
}

Bins::Bins(const Sheet& sheet, int columns, int rows, int tile_columns, int tile_rows, Poll& poll)
    : columns_(columns),
      rows_(rows),
      tile_columns_(tile_columns),
      tile_rows_(tile_rows),
      across_((columns + tile_columns - 1) / tile_columns),
      down_((rows + tile_rows - 1) / tile_rows),
      first_(std::size_t(count()) + 1) {
    each_tile(sheet, poll, [&](std::size_t tile, std::int64_t) { ++first_[tile + 1]; });
    for (std::size_t k = 1; k < first_.size(); ++k) first_[k] += first_[k - 1];
    triangles_.resize(std::size_t(first_.back()));
    std::vector<std::int64_t> next(first_.begin(), first_.end() - 1);
    each_tile(sheet, poll,
              [&](std::size_t tile, std::int64_t n) { triangles_[std::size_t(next[tile]++)] = n; });
}

template <class Visit>
void Bins::each_tile(const Sheet& sheet, Poll& poll, Visit visit) const {
    for (std::int64_t n = 0; n < sheet.triangles(); ++n) {
        if (n % triangles_between_questions == 0 && poll.stopped()) return;
        const Box box = this->box(sheet, n);
        if (box.empty()) continue;
        for (int row = box.top / tile_rows_; row <= (box.bottom - 1) / tile_rows_; ++row)
            for (int column = box.left / tile_columns_; column <= (box.right - 1) / tile_columns_; ++column)
                visit(std::size_t(row * across_ + column), n);
    }
}

Box Bins::tile(int number) const {
    const int left = number % across_ * tile_columns_, top = number / across_ * tile_rows_;
    return {left, top, std::min(columns_, left + tile_columns_), std::min(rows_, top + tile_rows_)};
}

std::int64_t Bins::most() const {
    std::int64_t most = 0;
    for (int tile = 0; tile < count(); ++tile) most = std::max(most, first(tile + 1) - first(tile));
    return most;
}

namespace {

// Samples of a row, from the given column of the facet's box on, that the facet covers nearer than what was
// there.
CLOTHSIM_VERSIONS void cover(const Facet& facet, double number, int column, double dy, int count,
                             double* __restrict nearness, double* __restrict nearest) {
    for (int k = 0; k < count; ++k) {
        const double x = facet.x + double(column + k);
        const double b = facet.b(x, dy), c = facet.c(x, dy);
        const double here = facet.nearness + b * facet.b_nearness + c * facet.c_nearness;
        const bool covered = (b >= 0) & (c >= 0) & (b + c <= 1) & (here > nearness[k]);
        nearness[k] = covered ? here : nearness[k];
        nearest[k] = covered ? number : nearest[k];
    }
}

}  // namespace

Nearest::Nearest(int columns, int rows, std::int64_t most)
    : width(columns), nearness(std::size_t(columns) * std::size_t(rows)), facet(nearness.size()) {
    facets.reserve(std::size_t(most));
}

bool Nearest::find(const Sheet& sheet, const Bins& bins, int tile, Poll& poll) {
    const Box whole = bins.tile(tile);
    std::fill(nearness.begin(), nearness.end(), -std::numeric_limits<double>::infinity());
    std::fill(facet.begin(), facet.end(), -1.0);
    facets.clear();
    for (std::int64_t k = bins.first(tile); k < bins.first(tile + 1); ++k) {
        if (poll.stopped()) return false;
        const Facet one = facet_of(sheet, bins[k], bins.box(sheet, bins[k]));
        facets.push_back(one);
        const Box box = intersection(one.box, whole);
        for (int row = box.top; row < box.bottom; ++row) {
            const std::size_t at = this->at(whole, box.left, row);
            cover(one, double(facets.size() - 1), box.left - one.box.left, one.y + (row - one.box.top),
                  box.right - box.left, &nearness[at], &facet[at]);
        }
    }
    return true;
}

}  // namespace clothsim::picture
