// Sums over contacts of a cloth: impulse and work of each obstacle, and the extremes so far.
#pragma once

#include <algorithm>
#include <limits>

#include "forces/penalty_arguments.hpp"
#include "lanes/aligned_vector.hpp"
#include "model/motion.hpp"

namespace clothsim {

struct ContactSums {
    Vec3 impulse = Vec3::Zero();  // of the force on the cloth [N s]
    double work = 0;              // of that force at the velocity of the obstacle [J]
    double deepest = 0;           // in the layer, at the states between steps [m]
    double first = std::numeric_limits<double>::infinity();  // time of the first contact [s]
};

// The blocks of a cloth, see ContactBlock.
class ContactTally {
public:
    ContactTally() = default;
    ContactTally(std::size_t obstacles, int rows, int groups, int lanes)
        : rows_(rows), groups_(groups), lanes_(lanes) {
        values_.assign(obstacles * std::size_t(rows * groups * size()), 0.0);
    }

    bool empty() const { return values_.empty(); }
    int lanes() const { return lanes_; }
    double* data() { return values_.data(); }
    std::ptrdiff_t row() const { return groups_ * size(); }
    std::ptrdiff_t obstacle() const { return rows_ * row(); }

    void clear() { std::fill(values_.begin(), values_.end(), 0.0); }
    void clear_rows(int begin, int end) {
        each_block(begin, end, [&](double* block) {
            if (block[tail() + ContactBlock::touched] != 0) std::fill_n(block, size(), 0.0);
        });
    }
    // Add the sums of other blocks in some rows, `weight` times. `noted`: their extremes count.
    void add_rows(const ContactTally& other, double weight, bool noted, int begin, int end) {
        each_block(begin, end, [&](double* block) {
            const double* const from = other.values_.data() + (block - values_.data());
            const double* const from_tail = from + tail();
            if (from_tail[ContactBlock::touched] == 0) return;
            for (int i = 0; i < ContactBlock::depth * lanes_; ++i) block[i] += weight * from[i];
            double* const to_tail = block + tail();
            to_tail[ContactBlock::touched] = 1;
            if (!noted) return;
            for (int i = ContactBlock::depth * lanes_; i < tail(); ++i)
                block[i] = std::max(block[i], from[i]);
            if (from_tail[ContactBlock::met] != 0)
                note_first(block, from_tail[ContactBlock::first]);
        });
    }
    void note_first(double* block, double time) const {
        double* const own = block + tail();
        own[ContactBlock::first] =
            own[ContactBlock::met] != 0 ? std::min(own[ContactBlock::first], time) : time;
        own[ContactBlock::met] = own[ContactBlock::touched] = 1;
    }
    // Sums go on; depths and times of contact begin anew.
    void forget_extremes() {
        each_block(0, rows_, [&](double* block) {
            std::fill_n(block + ContactBlock::depth * lanes_, lanes_, 0.0);
            block[tail() + ContactBlock::first] = block[tail() + ContactBlock::met] = 0;
        });
    }
    // The first block of a row, for the scalar integrators.
    double* block(std::size_t obstacle, int at) {
        return values_.data() + std::ptrdiff_t(obstacle) * this->obstacle() + at * row();
    }
    // Add a force times a duration, at the velocity of the obstacle.
    void add(double* block, const Vec3& impulse, const Vec3& velocity) const {
        for (int k = 0; k < 3; ++k) block[k * lanes_] += impulse[k];
        block[ContactBlock::work * lanes_] += impulse.dot(velocity);
        block[tail() + ContactBlock::touched] = 1;
    }
    void note_depth(double* block, double depth, double time) const {
        double& deepest = block[ContactBlock::depth * lanes_];
        deepest = std::max(deepest, depth);
        note_first(block, time);
    }

    // All rows, in their order.
    ContactSums of(std::size_t obstacle) const {
        ContactSums all;
        if (empty()) return all;
        const double* block = values_.data() + std::ptrdiff_t(obstacle) * this->obstacle();
        const auto sum = [&](int field) {
            double total = 0;
            for (int i = 0; i < lanes_; ++i) total += block[field * lanes_ + i];
            return total;
        };
        for (int i = 0; i < rows_ * groups_; ++i, block += size()) {
            if (block[tail() + ContactBlock::touched] == 0) continue;
            for (int k = 0; k < 3; ++k) all.impulse[k] += sum(k);
            all.work += sum(ContactBlock::work);
            for (int l = 0; l < lanes_; ++l)
                all.deepest = std::max(all.deepest, block[ContactBlock::depth * lanes_ + l]);
            if (block[tail() + ContactBlock::met] != 0)
                all.first = std::min(all.first, block[tail() + ContactBlock::first]);
        }
        return all;
    }

    // The sums as they are saved: of each row x, y, z and work, lane by lane.
    std::vector<double> sums() const {
        std::vector<double> all;
        for (std::size_t at = 0; at < values_.size(); at += std::size_t(size()))
            all.insert(all.end(), values_.begin() + std::ptrdiff_t(at),
                       values_.begin() + std::ptrdiff_t(at) + ContactBlock::depth * lanes_);
        return all;
    }
    // Go on from saved sums of as many obstacles and rows; others begin at 0.
    void go_on(const std::vector<double>& sums) {
        clear();
        if (values_.empty()) return;
        const std::size_t blocks = values_.size() / std::size_t(size());
        const std::size_t saved = sums.size() / blocks / ContactBlock::depth;
        if (sums.size() != blocks * ContactBlock::depth * saved) return;
        const double* from = sums.data();
        for (std::size_t i = 0; i < blocks; ++i) {
            double* const to = values_.data() + std::ptrdiff_t(i) * size();
            to[tail() + ContactBlock::touched] = 1;
            for (int field = 0; field < ContactBlock::depth; ++field)
                for (std::size_t l = 0; l < saved; ++l)
                    to[field * lanes_ + int(l) % lanes_] += *from++;
        }
    }

private:
    std::ptrdiff_t size() const { return ContactBlock::size(lanes_); }
    std::ptrdiff_t tail() const { return ContactBlock::tail * lanes_; }
    template <class Visit>
    void each_block(int begin, int end, Visit visit) {
        for (std::ptrdiff_t at = 0; at < std::ptrdiff_t(values_.size()); at += obstacle())
            for (std::ptrdiff_t b = begin * row(); b < end * row(); b += size())
                visit(values_.data() + at + b);
    }

    int rows_ = 0, groups_ = 0, lanes_ = 0;
    AlignedVector<double> values_;
};

}  // namespace clothsim
