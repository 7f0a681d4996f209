// Internal to stars: the nearest of the points that stand in the order of their places. Blocks of consecutive
// places are searched together: their neighbours are in much the same blocks.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/core/parallel.h"
#include "toolkit/stars/float_box.h"
#include "toolkit/stars/places.h"
#include "toolkit/stars/star_mesh.h"

namespace palpate::stars {

/// Places near another, nearest first, of equal distances the lowest first; `size` of them.
struct Nearby {
  std::vector<std::uint32_t> place;
  std::vector<float> square;  ///< squared distances, mm^2
  std::size_t size = 0;
};

/// A search's own memory.
struct NearScratch {
  std::vector<std::uint32_t> blocks;  ///< that may hold the nearest, ascending
  std::vector<float> key;
  std::vector<std::uint32_t> place;
  std::vector<std::uint32_t> rank;
  std::vector<std::uint64_t> pairs;
};

class NearPlaces {
 public:
  /// Points that `skipped` marks are nobody's neighbour. Parallel, O(n).
  NearPlaces(const UnsetVector<Placed>& point, const std::vector<std::uint8_t>& skipped, int threads);

  /// use(first place, bits, found) for each block with places that are not skipped, and of those only the
  /// `wanted` where any are: for each bit k the `most` nearest of place first + k, or all where there are
  /// fewer. Parallel by blocks; the same for any number of threads.
  template <class Use>
  void run(std::size_t most, std::span<const std::uint8_t> wanted, int threads, Use&& use) const {
    parallel_chunks(blocks_, kBlocksPerChunk, threads, [&](std::size_t begin, std::size_t end) {
      NearScratch scratch;
      std::array<Nearby, kBlockPlaces> found;
      float radius = 0.0F;
      for (std::size_t block = begin; block < end; ++block) {
        const unsigned places = wanted_in(block, wanted);
        if (places == 0) continue;
        radius = search(block, places, most, radius, scratch, found);
        use(static_cast<std::uint32_t>(block * kBlockPlaces), places, found);
      }
    });
  }

 private:
  static constexpr std::size_t kBlocksPerChunk = 512;

  [[nodiscard]] unsigned wanted_in(std::size_t block, std::span<const std::uint8_t> wanted) const noexcept;
  /// The radius that held the nearest of all `places` (bits) of the block; `guess` is one to begin with.
  float search(std::size_t block, unsigned places, std::size_t most, float guess, NearScratch& scratch,
               std::array<Nearby, kBlockPlaces>& found) const;
  /// False where the box holds all there is.
  bool gather(const FloatBox& box, std::vector<std::uint32_t>& blocks) const;

  std::size_t count_ = 0, blocks_ = 0;
  float first_radius_ = 0.0F;                 ///< where a block is but one point: the spacing of all
  UnsetVector<float> x_, y_, z_;              ///< by place; not a number where skipped
  std::vector<std::vector<BoxNode>> levels_;  ///< 0: whose children are blocks; the last has one node
};

}  // namespace palpate::stars
