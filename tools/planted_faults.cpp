// Faults that tools/sanitize.sh expects to be reported, and a loop that it expects not to be.
#include <thread>
#include <vector>

extern "C" {

// Two threads fill a half each, and one reads all when the other has ended.
void none() {
    std::vector<int> values(1000, 0);
    int sum = 0;
    const auto fill = [&](int begin) {
        for (int i = begin; i < begin + 500; ++i) values[i] = i;
    };
    std::thread other(fill, 500);
    fill(0);
    other.join();
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
    const auto count = [&] {
        for (int i = 0; i < 10000; ++i) shared = shared + 1;
    };
    std::thread other(count);
    count();
    other.join();
    return shared;
}
}
