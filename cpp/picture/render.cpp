#include <atomic>

#include "memory/threads.hpp"
#include "picture/tile.hpp"

namespace clothsim::picture {

bool render(const Picture& picture, int threads, const std::function<bool()>& interrupted,
            std::uint8_t* pixels) {
    const View& view = picture.view;
    Poll poll(interrupted);
    const Bins bins(picture.sheet, view.columns(), view.rows(), tile_width * view.samples,
                    tile_height * view.samples, poll);
    const Shadow shadow(picture, poll);
    if (poll.stopped()) return false;
    std::vector<Tile> tiles;
    for (int thread = 0; thread < threads; ++thread) tiles.emplace_back(picture, bins, shadow);
    std::atomic<int> next{0};
    in_team(threads, [&](int thread, int) {
        Tile& tile = tiles[std::size_t(thread)];
        for (int n = next++; n < bins.count() && tile.draw(n, poll, pixels); n = next++) continue;
    });
    return !poll.stopped();
}

}  // namespace clothsim::picture
