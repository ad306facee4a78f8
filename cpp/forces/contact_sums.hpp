// Sums over contacts of a cloth: impulse and work of each obstacle, and the extremes so far.
#pragma once

#include <algorithm>
#include <limits>

#include "forces/penalty_arguments.hpp"
#include "lanes/aligned_vector.hpp"
#include "model/motion.hpp"

namespace clothsim {

struct ContactSums {
    Vec3 impulse = Vec3::Zero();  // N s, of the force on the cloth
    double work = 0;              // J, of that force at the velocity of the obstacle
    double deepest = 0;           // m, in the layer at the states between steps
    double first = std::numeric_limits<double>::infinity();  // time of the first contact [s]
};

// The records of a cloth, see ContactRecord.
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
    std::ptrdiff_t row_size() const { return groups_ * size(); }
    std::ptrdiff_t obstacle_size() const { return rows_ * row_size(); }

    void clear() { std::fill(values_.begin(), values_.end(), 0.0); }
    void clear_rows(int begin, int end) {
        each_record(begin, end, [&](double* record) {
            if (record[tail() + ContactRecord::touched] != 0) std::fill_n(record, size(), 0.0);
        });
    }
    // Add the sums of other records in some rows, `weight` times. `with_extremes`: their extremes
    // count.
    void add_rows(const ContactTally& other, double weight, bool with_extremes, int begin,
                  int end) {
        each_record(begin, end, [&](double* record) {
            const double* const from = other.values_.data() + (record - values_.data());
            const double* const from_tail = from + tail();
            if (from_tail[ContactRecord::touched] == 0) return;
            for (int i = 0; i < ContactRecord::depth * lanes_; ++i) record[i] += weight * from[i];
            double* const to_tail = record + tail();
            to_tail[ContactRecord::touched] = 1;
            if (!with_extremes) return;
            for (int i = ContactRecord::depth * lanes_; i < tail(); ++i)
                record[i] = std::max(record[i], from[i]);
            if (from_tail[ContactRecord::met] != 0)
                note_first_contact(record, from_tail[ContactRecord::first]);
        });
    }
    void note_first_contact(double* record, double time) const {
        double* const own = record + tail();
        own[ContactRecord::first] =
            own[ContactRecord::met] != 0 ? std::min(own[ContactRecord::first], time) : time;
        own[ContactRecord::met] = own[ContactRecord::touched] = 1;
    }
    // Sums go on; depths and times of contact begin anew.
    void forget_extremes() {
        each_record(0, rows_, [&](double* record) {
            std::fill_n(record + ContactRecord::depth * lanes_, lanes_, 0.0);
            record[tail() + ContactRecord::first] = record[tail() + ContactRecord::met] = 0;
        });
    }
    // Return the first record of a row, for the scalar integrators.
    double* record(std::size_t obstacle, int at) {
        return values_.data() + std::ptrdiff_t(obstacle) * obstacle_size() + at * row_size();
    }
    // Add a force times a duration, at the velocity of the obstacle.
    void add(double* record, const Vec3& impulse, const Vec3& velocity) const {
        for (int k = 0; k < 3; ++k) record[k * lanes_] += impulse[k];
        record[ContactRecord::work * lanes_] += impulse.dot(velocity);
        record[tail() + ContactRecord::touched] = 1;
    }
    void note_depth(double* record, double depth, double time) const {
        double& deepest = record[ContactRecord::depth * lanes_];
        deepest = std::max(deepest, depth);
        note_first_contact(record, time);
    }

    // Add up all rows, in their order.
    ContactSums of(std::size_t obstacle) const {
        ContactSums all;
        if (empty()) return all;
        const double* record = values_.data() + std::ptrdiff_t(obstacle) * obstacle_size();
        const auto sum = [&](int field) {
            double total = 0;
            for (int i = 0; i < lanes_; ++i) total += record[field * lanes_ + i];
            return total;
        };
        for (int i = 0; i < rows_ * groups_; ++i, record += size()) {
            if (record[tail() + ContactRecord::touched] == 0) continue;
            for (int k = 0; k < 3; ++k) all.impulse[k] += sum(k);
            all.work += sum(ContactRecord::work);
            for (int l = 0; l < lanes_; ++l)
                all.deepest = std::max(all.deepest, record[ContactRecord::depth * lanes_ + l]);
            if (record[tail() + ContactRecord::met] != 0)
                all.first = std::min(all.first, record[tail() + ContactRecord::first]);
        }
        return all;
    }

    // Return the sums as they are saved: of each row x, y, z and work, lane by lane.
    std::vector<double> sums() const {
        std::vector<double> all;
        for (std::size_t at = 0; at < values_.size(); at += std::size_t(size()))
            all.insert(all.end(), values_.begin() + std::ptrdiff_t(at),
                       values_.begin() + std::ptrdiff_t(at) + ContactRecord::depth * lanes_);
        return all;
    }
    // Go on from saved sums of as many obstacles and rows; others begin at 0.
    void continue_from(const std::vector<double>& sums) {
        clear();
        if (values_.empty()) return;
        const std::size_t records = values_.size() / std::size_t(size());
        const std::size_t saved = sums.size() / records / ContactRecord::depth;
        if (sums.size() != records * ContactRecord::depth * saved) return;
        const double* from = sums.data();
        for (std::size_t i = 0; i < records; ++i) {
            double* const to = values_.data() + std::ptrdiff_t(i) * size();
            to[tail() + ContactRecord::touched] = 1;
            for (int field = 0; field < ContactRecord::depth; ++field)
                for (std::size_t l = 0; l < saved; ++l)
                    to[field * lanes_ + int(l) % lanes_] += *from++;
        }
    }

private:
    std::ptrdiff_t size() const { return ContactRecord::size(lanes_); }
    std::ptrdiff_t tail() const { return ContactRecord::tail * lanes_; }
    template <class Visit>
    void each_record(int begin_row, int end_row, Visit visit) {
        for (std::ptrdiff_t at = 0; at < std::ptrdiff_t(values_.size()); at += obstacle_size())
            for (std::ptrdiff_t b = begin_row * row_size(); b < end_row * row_size(); b += size())
                visit(values_.data() + at + b);
    }

    int rows_ = 0;
    int groups_ = 0;
    int lanes_ = 0;
    AlignedVector<double> values_;
};

}  // namespace clothsim
