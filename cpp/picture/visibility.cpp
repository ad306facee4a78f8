#include "picture/visibility.hpp"

#include "lanes/versions.hpp"

namespace clothsim::picture {
namespace {

constexpr std::int64_t triangles_between_questions = 1024;  // whether to end: some 30 us

Facet project_triangle(const Sheet& sheet, std::int64_t triangle) {
    const std::array<std::int64_t, 3> corners = sheet.corners(triangle);
    const double* const a = sheet.screen + 3 * corners[0];
    const double* const b = sheet.screen + 3 * corners[1];
    const double* const c = sheet.screen + 3 * corners[2];
    const double bx = b[0] - a[0];
    const double by = b[1] - a[1];
    const double cx = c[0] - a[0];
    const double cy = c[1] - a[1];
    const double twice_area = bx * cy - by * cx;
    // Of a triangle without area every weight is NaN or infinite, so that it covers nothing.
    return {
        corners,          triangle % 2 != 0, a[0], a[1],        cy / twice_area, -cx / twice_area,
        -by / twice_area, bx / twice_area,   a[2], b[2] - a[2], c[2] - a[2]};
}

// Samples of a row, from the given column on, that the facet covers nearer than what was there.
CLOTHSIM_VERSIONS void cover(const Facet& facet, double number, int column, double dy, int count,
                             double* __restrict nearness, double* __restrict nearest) {
    for (int k = 0; k < count; ++k) {
        const double x = column + k + 0.5 - facet.x;
        const double b = facet.b(x, dy);
        const double c = facet.c(x, dy);
        const double nearness_here = facet.nearness + b * facet.b_nearness + c * facet.c_nearness;
        const bool covered = (b >= 0) & (c >= 0) & (b + c <= 1) & (nearness_here > nearness[k]);
        nearness[k] = covered ? nearness_here : nearness[k];
        nearest[k] = covered ? number : nearest[k];
    }
}

}  // namespace

Box clipped(double left, double top, double right, double bottom, const Box& within) {
    // A side that is NaN becomes the far one, so that the box is empty.
    const auto place = [](double value, int low, int high) {
        return int(std::max(double(low), std::min(double(high), value)));
    };
    return {place(std::floor(left), within.left, within.right),
            place(std::floor(top), within.top, within.bottom),
            place(std::ceil(right), within.left, within.right),
            place(std::ceil(bottom), within.top, within.bottom)};
}

Bins::Bins(const Sheet& sheet, Box whole, int tile_columns, int tile_rows, Poll& poll)
    : whole_(whole),
      tile_columns_(tile_columns),
      tile_rows_(tile_rows),
      across_((whole.right + tile_columns - 1) / tile_columns),
      down_((whole.bottom + tile_rows - 1) / tile_rows),
      first_(std::size_t(count()) + 1) {
    each_tile(sheet, poll, [&](std::size_t tile, std::int64_t) { ++first_[tile + 1]; });
    for (std::size_t k = 1; k < first_.size(); ++k) first_[k] += first_[k - 1];
    triangles_.resize(std::size_t(first_.back()));
    std::vector<std::int64_t> next(first_.begin(), first_.end() - 1);
    each_tile(sheet, poll,
              [&](std::size_t tile, std::int64_t n) { triangles_[std::size_t(next[tile]++)] = n; });
}

Box Bins::box(const Sheet& sheet, std::int64_t triangle) const {
    std::array<double, 2> low{HUGE_VAL, HUGE_VAL}, high{-HUGE_VAL, -HUGE_VAL};
    for (const std::int64_t corner : sheet.corners(triangle)) {
        const double* const p = sheet.screen + 3 * corner;
        if (!std::isfinite(p[0] + p[1] + p[2])) return {};
        for (std::size_t k = 0; k < 2; ++k)
            low[k] = std::min(low[k], p[k]), high[k] = std::max(high[k], p[k]);
    }
    return clipped(low[0], low[1], high[0], high[1], whole_);
}

template <class Visit>
void Bins::each_tile(const Sheet& sheet, Poll& poll, Visit visit) const {
    for (std::int64_t n = 0; n < sheet.triangles(); ++n) {
        if (n % triangles_between_questions == 0 && poll.stopped()) return;
        const Box box = this->box(sheet, n);
        if (box.left >= box.right || box.top >= box.bottom) continue;
        for (int row = box.top / tile_rows_; row <= (box.bottom - 1) / tile_rows_; ++row)
            for (int column = box.left / tile_columns_; column <= (box.right - 1) / tile_columns_;
                 ++column)
                visit(std::size_t(row * across_ + column), n);
    }
}

Box Bins::tile(int number) const {
    const int left = number % across_ * tile_columns_;
    const int top = number / across_ * tile_rows_;
    return {left, top, std::min(whole_.right, left + tile_columns_),
            std::min(whole_.bottom, top + tile_rows_)};
}

Nearest::Nearest(int columns, int rows)
    : width(columns), nearness(std::size_t(columns) * std::size_t(rows)), facet(nearness.size()) {}

bool Nearest::find(const Sheet& sheet, const Bins& bins, int tile, Poll& poll) {
    const Box whole = bins.tile(tile);
    std::fill(nearness.begin(), nearness.end(), -HUGE_VAL);
    std::fill(facet.begin(), facet.end(), -1.0);
    facets.clear();
    for (std::int64_t k = bins.first_[std::size_t(tile)]; k < bins.first_[std::size_t(tile) + 1];
         ++k) {
        if (poll.stopped()) break;
        const std::int64_t triangle = bins.triangles_[std::size_t(k)];
        const Box all = bins.box(sheet, triangle);
        const Box box = clipped(all.left, all.top, all.right, all.bottom, whole);
        facets.push_back(project_triangle(sheet, triangle));
        for (int row = box.top; row < box.bottom; ++row) {
            const std::size_t at = this->at(whole, box.left, row);
            cover(facets.back(), double(facets.size() - 1), box.left, row + 0.5 - facets.back().y,
                  box.right - box.left, &nearness[at], &facet[at]);
        }
    }
    return !poll.stopped();
}

}  // namespace clothsim::picture
