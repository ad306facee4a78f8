// A sphere in a picture: the samples that it may cover, and its nearest point at each of them.
#pragma once

#include "picture/frame.hpp"
#include "picture/visibility.hpp"

namespace clothsim::picture {

// From a sample of the plane through the target [m] to the eye.
struct Ray {
    double x, y;
    Triple to_eye;  // unit vector
};
Ray ray(const View& view, int column, int row);

class Disc {
public:
    Disc(const View& view, const Triple& center, double radius);

    Box box;
    double nearness;  // of the centre

    // Whether the sphere covers a sample; if so, the nearness there, and the normal in the axes of the view.
    bool hit(int column, int row, double& nearness, Triple& normal) const;

private:
    bool hit_in_perspective(int column, int row, double& nearness, Triple& normal) const;

    const View& view_;
    const Triple center_;  // in the axes of the view
    const double radius_, slack_;
    double x_, y_, reach_;  // samples
};

}  // namespace clothsim::picture
