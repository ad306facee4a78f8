// RKC2, the Runge-Kutta-Chebyshev method of order 2: an explicit method with as many stages as the
// damping of the state asks for. Sommeijer, Shampine, Verwer: RKC: an explicit solver for parabolic
// PDEs, J. Comput. Appl. Math. 88 (1998) 315.
//
// With y = (x, v), slopes f = (v, a) and the increments d_j = y_j - y_0, d_0 = 0,
//
//     d_1 = mu~_1 h f_0
//     d_j = mu_j d_(j-1) + nu_j d_(j-2) + mu~_j h f_(j-1) + gamma~_j h f_0,   y_1 = y_0 + d_s
//     estimate of the error: -0.8 d_s + 0.4 h (f_0 + f at the end)
//
// s stages are stable for z = lambda h on the real axis from 0 down to -0.65 (s^2 - 1). Beside the
// axis the stable strip is narrow; see `longest_step`.
#pragma once

#include <vector>

namespace clothsim {

struct ChebyshevMethod {
    struct StageWeights {
        double mu = 0, nu = 0;  // of the increments of the last stage and of the one before
        double slope = 0,
               first_slope = 0;  // mu~ and gamma~: times h f of the last stage, of the start
        double part = 0;  // c_j: the time of the stage, as part of the step
    };
    explicit ChebyshevMethod(int stages);

    int stages;  // s, at least 2
    std::vector<StageWeights> stage;  // [j] of stage j, from 1 on; [stages] is the result
    // Weights of the accelerations at stages j = 0 to s - 1 in the velocity at the end, times h.
    std::vector<double> weights;

    static constexpr int error_order = 3;  // the power of the step with which the estimate falls
    static constexpr double error_of_increment = -0.8;
    static constexpr double error_of_slopes = 0.4;
};

// Returns the stages that are stable for modes of this damping rate in a step of h [s].
int chebyshev_stages(double rate, double h);

// The longest step for modes up to a squared frequency [1/s^2] and a damping rate [1/s].
//
// Where damping is in proportion to stiffness, c = tau k, the modes from omega^2 = 0 to 4 / tau^2
// are on a circle through 0 of radius h / tau in the plane of z. It is stable up to h = 2.24 tau
// with 5 stages, 2.44 with 8 and 2.56 with 40; steps of so many stages are the long ones.
double longest_chebyshev_step(double stiffness, double damping);

}  // namespace clothsim
