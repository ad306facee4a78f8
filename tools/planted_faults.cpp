// Faults that tools/sanitize.sh expects to be reported, and a loop that it expects not to be.
#include <vector>

extern "C" {

// Two threads of OpenMP fill a half each, and one reads all after the loop.
void none() {
    std::vector<int> values(1000, 0);
    int sum = 0;
#pragma omp parallel for num_threads(2)
    for (int i = 0; i < 1000; ++i) values[i] = i;
    for (const int value : values) sum += value;
    static_cast<void>(sum);
}

int heap_overflow() {
    std::vector<int> values(4, 0);
    return values.data()[4];
}

int float_cast() {
    volatile double large = 1e300;
    return int(large);
}

// Two threads write to one number.
int race() {
    int shared = 0;
#pragma omp parallel num_threads(2)
    for (int i = 0; i < 10000; ++i) shared = shared + 1;
    return shared;
}
}
