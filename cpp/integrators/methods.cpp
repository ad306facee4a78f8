#include "integrators/methods.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace clothsim {
namespace {

struct Entry {
    int row, column;
    double value;
};

using Matrix = std::vector<std::vector<double>>;

// clang-format off

// Dormand and Prince, J. Comput. Appl. Math. 6 (1980) 19; dense output of order 4: Shampine, Math.
// Comp. 46 (1986) 135, as polynomials in the part of the step.
constexpr Entry dopri5_a[] = {
    {1, 0, 1.0 / 5},         {2, 0, 3.0 / 40},        {2, 1, 9.0 / 40},       {3, 0, 44.0 / 45},
    {3, 1, -56.0 / 15},      {3, 2, 32.0 / 9},
    {4, 0, 19372.0 / 6561},  {4, 1, -25360.0 / 2187}, {4, 2, 64448.0 / 6561}, {4, 3, -212.0 / 729},
    {5, 0, 9017.0 / 3168},   {5, 1, -355.0 / 33},     {5, 2, 46732.0 / 5247}, {5, 3, 49.0 / 176},
    {5, 4, -5103.0 / 18656},
    {6, 0, 35.0 / 384},      {6, 2, 500.0 / 1113},    {6, 3, 125.0 / 192},
    {6, 4, -2187.0 / 6784},  {6, 5, 11.0 / 84},
};
constexpr double dopri5_error[] = {
    -71.0 / 57600, 0, 71.0 / 16695, -71.0 / 1920, 17253.0 / 339200, -22.0 / 525, 1.0 / 40,
};
constexpr Entry dopri5_dense[] = {
    {0, 0, 1},
    {0, 1, -8048581381.0 / 2820520608},
    {0, 2, 8663915743.0 / 2820520608},
    {0, 3, -12715105075.0 / 11282082432},
    {2, 1, 131558114200.0 / 32700410799},
    {2, 2, -68118460800.0 / 10900136933},
    {2, 3, 87487479700.0 / 32700410799},
    {3, 1, -1754552775.0 / 470086768},
    {3, 2, 14199869525.0 / 1410260304},
    {3, 3, -10690763975.0 / 1880347072},
    {4, 1, 127303824393.0 / 49829197408},
    {4, 2, -318862633887.0 / 49829197408},
    {4, 3, 701980252875.0 / 199316789632},
    {5, 1, -282668133.0 / 205662961},
    {5, 2, 2019193451.0 / 616988883},
    {5, 3, -1453857185.0 / 822651844},
    {6, 1, 40617522.0 / 29380423},
    {6, 2, -110615467.0 / 29380423},
    {6, 3, 69997945.0 / 29380423},
};

// dop853.f of Hairer and Wanner, after Hairer, Norsett, Wanner: Solving Ordinary Differential
// Equations I, 2nd ed., II.5. Its interpolant of order 7 is not used. Most cloths want a step near
// the stability limit; there the interpolant is up to some ten times less accurate than the step
// itself.
constexpr Entry dop853_a[] = {
    {1, 0, 0.05260015195876773}, {2, 0, 0.0197250569845379}, {2, 1, 0.059175170953613701},
    {3, 0, 0.029587585476806851}, {3, 2, 0.088762756430420545}, {4, 0, 0.24136513415926669},
    {4, 2, -0.88454947932828609}, {4, 3, 0.92483400326179199}, {5, 0, 0.037037037037037035},
    {5, 3, 0.17082860872947386}, {5, 4, 0.12546768756682242}, {6, 0, 0.037109375},
    {6, 3, 0.17025221101954405}, {6, 4, 0.060216538980455959}, {6, 5, -0.017578125},
    {7, 0, 0.037092000118504789}, {7, 3, 0.17038392571223998}, {7, 4, 0.10726203044637328},
    {7, 5, -0.015319437748624402}, {7, 6, 0.0082737891638140233}, {8, 0, 0.62411095871607569},
    {8, 3, -3.3608926294469414}, {8, 4, -0.86821934684172597}, {8, 5, 27.59209969944671},
    {8, 6, 20.154067550477894}, {8, 7, -43.489884181069961}, {9, 0, 0.47766253643826434},
    {9, 3, -2.4881146199716677}, {9, 4, -0.59029082683684297}, {9, 5, 21.230051448181193},
    {9, 6, 15.279233632882423}, {9, 7, -33.288210968984863}, {9, 8, -0.020331201708508627},
    {10, 0, -0.9371424300859873}, {10, 3, 5.1863724288440638}, {10, 4, 1.0914373489967295},
    {10, 5, -8.1497870107469268}, {10, 6, -18.520065659996959}, {10, 7, 22.739487099350505},
    {10, 8, 2.4936055526796523}, {10, 9, -3.0467644718982196}, {11, 0, 2.273310147516538},
    {11, 3, -10.534495466737249}, {11, 4, -2.0008720582248625}, {11, 5, -17.958931863118799},
    {11, 6, 27.94888452941996}, {11, 7, -2.8589982771350235}, {11, 8, -8.8728569335306293},
    {11, 9, 12.360567175794303}, {11, 10, 0.64339274601576357},
};
constexpr double dop853_b[] = {
    0.054293734116568765, 0, 0, 0,
    0, 4.4503128927524092, 1.8915178993145003, -5.8012039600105849,
    0.3111643669578199, -0.15216094966251609, 0.20136540080403034, 0.044710615727772587,
};
constexpr double dop853_error_5[] = {
    0.01312004499419488, 0, 0, 0,
    0, -1.2251564463762044, -0.4957589496572502, 1.6643771824549864,
    -0.35032884874997366, 0.33417911871301748, 0.08192320648511571, -0.022355307863886294,
    0,
};
constexpr double dop853_error_3[] = {
    -0.18980075407240762, 0, 0, 0,
    0, 4.4503128927524092, 1.8915178993145003, -5.8012039600105849,
    -0.42268232132379191, -0.15216094966251609, 0.20136540080403034, 0.022651792198360821,
    0,
};

// clang-format on

template <int count>
void fill(Matrix& matrix, const Entry (&entries)[count]) {
    for (const Entry& e : entries) matrix[std::size_t(e.row)][std::size_t(e.column)] = e.value;
}

Matrix square_matrix(int size) {
    return Matrix(std::size_t(size), std::vector<double>(std::size_t(size), 0.0));
}

// A sum of products, as exact as in twice the precision (Ogita, Rump, Oishi, SIAM J. Sci. Comput.
// 26 (2005) 1955).
struct Sum {
    double high = 0;
    double low = 0;
    double size = 0;
    void add(double a, double b) {
        const double product = a * b;
        const double next = high + product;
        const double part = next - high;
        low += std::fma(a, b, -product) + ((high - (next - part)) + (product - part));
        high = next;
        size += std::abs(product);
    }
    double value() const { return high + low; }
};

// Returns a row of weights of slopes as factors of accelerations. The slopes of x are the stage
// velocities. They are expressed by v and the earlier accelerations.
Weights nystroem(const std::vector<double>& row, const Matrix& a) {
    const std::size_t n = row.size();
    Weights w;
    w.x.assign(n, 0.0);
    w.v = row;
    Sum drift;
    for (const double value : row) drift.add(value, 1);
    w.drift = drift.value();
    for (std::size_t l = 0; l < n; ++l) {
        Sum sum;
        for (std::size_t j = l + 1; j < n; ++j) sum.add(row[j], a[j][l]);
        // The method's conditions make this 0; rounding of its coefficients leaves a remainder.
        w.x[l] = std::abs(sum.value()) <= 1e-14 * sum.size ? 0.0 : sum.value();
    }
    return w;
}

// `a` is the tableau with the row of the result.
ExplicitMethod make_explicit(int stages, int order, Matrix a,
                             const std::vector<std::vector<double>>& errors) {
    ExplicitMethod m;
    m.stages = stages;
    m.order = order;
    m.a = std::move(a);
    const auto weights = [&](std::size_t i) { return nystroem(m.a[i], m.a); };
    m.stage.emplace_back();
    for (int i = 1; i < stages; ++i) m.stage.push_back(weights(std::size_t(i)));
    m.result = weights(std::size_t(stages));
    for (std::vector<double> error : errors) {
        error.resize(m.a.size(), 0.0);
        m.errors.push_back(nystroem(error, m.a));
        m.errors.back().drift = 0;
        m.error_needs_end |= error[std::size_t(stages)] != 0;
    }
    return m;
}

template <int count>
std::vector<double> vector_of(const double (&values)[count]) {
    return {values, values + count};
}

ExplicitMethod make_dopri5() {
    Matrix a = square_matrix(7);
    fill(a, dopri5_a);
    ExplicitMethod m = make_explicit(6, 5, a, {vector_of(dopri5_error)});
    m.dense_factors = Matrix(7, std::vector<double>(4, 0.0));
    fill(m.dense_factors, dopri5_dense);
    return m;
}

ExplicitMethod make_dop853() {
    Matrix a = square_matrix(13);
    fill(a, dop853_a);
    for (int j = 0; j < 12; ++j) a[12][std::size_t(j)] = dop853_b[j];
    return make_explicit(12, 8, a, {vector_of(dop853_error_5), vector_of(dop853_error_3)});
}

// Kutta, Z. Math. Phys. 46 (1901) 435.
ExplicitMethod make_rk4() {
    Matrix a = square_matrix(5);
    a[1][0] = a[2][1] = 1.0 / 2;
    a[3][2] = 1;
    a[4] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6, 0};
    return make_explicit(4, 4, a, {});
}

// Euler, Institutiones calculi integralis 1 (1768), 650.
ExplicitMethod make_explicit_euler() { return make_explicit(1, 1, {{0, 0}, {1, 0}}, {}); }

// Velocity Verlet with damping: the second kick takes the velocity that Euler's method predicts.
// The weights of x are the method's own, x + h v + h^2/2 a.
ExplicitMethod make_damped_verlet() {
    ExplicitMethod m;
    m.stages = 2;
    m.stage = {{}, {1, {0.5, 0}, {1, 0}}};
    m.result = {1, {0.5, 0}, {0.5, 0.5}};
    return m;
}

const ExplicitMethod rk4 = make_rk4();
const ExplicitMethod explicit_euler = make_explicit_euler();
const ExplicitMethod dopri5 = make_dopri5();
const ExplicitMethod dop853 = make_dop853();
const ExplicitMethod damped_verlet = make_damped_verlet();

const Splitting semi_implicit_euler{{0, 1}, {1}};
const Splitting velocity_verlet{{0, 1, 0}, {0.5, 0.5}};

// Omelyan, Mryglod, Folk, Comput. Phys. Commun. 146 (2002) 188, eq 20.
constexpr double xi = 0.1786178958448091, lambda = -0.2123418310626054, chi = -0.06626458266981849;
const Splitting pefrl{{xi, chi, 1 - 2 * (chi + xi), chi, xi},
                      {(1 - 2 * lambda) / 2, lambda, lambda, (1 - 2 * lambda) / 2}};

const std::vector<Method> methods{
    {.name = "rk4", .runge_kutta = &rk4, .in_kernels = true},
    {.name = "explicit_euler", .runge_kutta = &explicit_euler},
    {.name = "semi_implicit_euler", .splitting = &semi_implicit_euler},
    {.name = "velocity_verlet", .splitting = &velocity_verlet, .damped = &damped_verlet},
    {.name = "pefrl", .splitting = &pefrl},
    {.name = "dopri5", .runge_kutta = &dopri5},
    {.name = "dop853", .runge_kutta = &dop853},
    {.name = "rkc2", .stabilised = true},
    {.name = "implicit_midpoint"},
};

}  // namespace

Weights ExplicitMethod::dense(double part) const {
    std::vector<double> w(a.size(), 0.0);
    for (std::size_t j = 0; j < w.size(); ++j)
        for (std::size_t k = dense_factors[j].size(); k-- > 0;)
            w[j] = (w[j] + dense_factors[j][k]) * part;
    return nystroem(w, a);
}

std::span<const Method> all_methods() { return methods; }

const Method& method_of(std::string_view name) {
    for (const Method& m : methods)
        if (m.name == name) return m;
    throw std::invalid_argument("no integrator " + std::string(name));
}

double energy_swing(const Splitting& splitting, double omega_dt) {
    double m00 = 1;
    double m01 = 0;
    double m10 = 0;
    double m11 = 1;
    for (std::size_t i = 0; i < splitting.drifts.size(); ++i) {
        const double drift = splitting.drifts[i] * omega_dt;
        m00 += drift * m10;
        m01 += drift * m11;
        if (i == splitting.kicks.size()) break;
        const double kick = splitting.kicks[i] * omega_dt;
        m10 -= kick * m00;
        m11 -= kick * m01;
    }
    const double middle = (m01 - m10) / 2;
    const double radius = std::hypot((-m10 - m01) / 2, (m00 - m11) / 2);
    if (middle == 0) return 0;
    const double ratio = (std::abs(middle) - radius) / (std::abs(middle) + radius);
    return 1 - std::max(0.0, ratio);
}

}  // namespace clothsim
