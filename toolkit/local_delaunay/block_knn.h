// Nearest neighbours among points sorted by place. Blocks of consecutive places are searched together,
// because their neighbours lie in nearly the same blocks. Internal to local_delaunay.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/core/parallel.h"
#include "toolkit/local_delaunay/bvh_node.h"
#include "toolkit/local_delaunay/local_delaunay_mesh.h"
#include "toolkit/local_delaunay/spatial_sort.h"

namespace palpate::local_delaunay {

/// Neighbours by ascending distance, ties by lowest place; `size` of them.
struct KnnResult {
  std::vector<std::uint32_t> place;
  std::vector<float> square;  ///< squared distances, mm^2
  std::size_t size = 0;
};

/// Reusable memory of a search.
struct KnnScratch {
  std::vector<std::uint32_t> blocks;  ///< blocks that may hold neighbours, ascending
  std::vector<float> key;
  std::vector<std::uint32_t> place;
  std::vector<std::uint32_t> rank;
  std::vector<std::uint64_t> pairs;
};

class BlockKnn {
 public:
  /// Points marked in `skipped` are never neighbours. Parallel, O(n).
  BlockKnn(const UninitializedVector<SortedPoint>& point, const std::vector<std::uint8_t>& skipped,
           int threads);

  /// Calls use(first place, bits, found) for each block with places that are not skipped (and `wanted`, if
  /// given). For bit k, found holds the `most` nearest of place first + k, or all if fewer. Parallel by
  /// blocks; independent of the number of threads.
  template <class Use>
  void run(std::size_t most, std::span<const std::uint8_t> wanted, int threads, Use&& use) const {
    parallel_chunks(blocks_, kBlocksPerChunk, threads, [&](std::size_t begin, std::size_t end) {
      KnnScratch scratch;
      std::array<KnnResult, kBlockPlaces> found;
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
  /// Searches for the block's `places` (bits) from radius `guess`; returns the radius that sufficed.
  float search(std::size_t block, unsigned places, std::size_t most, float guess, KnnScratch& scratch,
               std::array<KnnResult, kBlockPlaces>& found) const;
  /// False if the box holds all points.
  bool gather(const FloatBox& box, std::vector<std::uint32_t>& blocks) const;

  std::size_t count_ = 0, blocks_ = 0;
  float first_radius_ = 0.0F;                 ///< initial radius for a block of coincident points: the mean
                                              ///< spacing
  UninitializedVector<float> x_, y_, z_;      ///< by place; NaN if skipped
  std::vector<std::vector<BvhNode>> levels_;  ///< level 0: children are blocks; the last level has one node
};

}  // namespace palpate::local_delaunay
