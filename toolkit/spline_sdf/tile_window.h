// Tiles of a large surface that are in memory. A loader thread fills places of the arenas and says so through
// a ring; the frame's thread alone changes what can be found. Nothing waits.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <type_traits>
#include <vector>

#include <palpate/triple_buffer.h>
#include "toolkit/core/hash.h"
#include "toolkit/spline_sdf/brick_tiles.h"

namespace palpate::spline_sdf {

/// A bounded lock-free queue from one thread to another. Unlike a TripleBuffer it loses nothing: a full ring
/// refuses. Exactly one thread pushes and one pops. Both are wait-free and allocate nothing. `kSize`: a power
/// of two.
template <class T, std::size_t kSize>
class SpscRing {
  static_assert(std::is_trivially_copyable_v<T> && kSize > 0 && (kSize & (kSize - 1)) == 0);

 public:
  /// False if the ring is full.
  [[nodiscard]] bool push(const T& value) noexcept {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    // Acquire: the reader is done with the place that is written next.
    if (tail - head_.load(std::memory_order_acquire) == kSize) return false;
    ring_[tail & (kSize - 1)] = value;
    // Release: the reader sees the value, and all that was written before it was pushed.
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }
  /// The pushing thread: whether push() would refuse.
  [[nodiscard]] bool full() const noexcept {
    return tail_.load(std::memory_order_relaxed) - head_.load(std::memory_order_acquire) == kSize;
  }
  /// False if the ring is empty.
  [[nodiscard]] bool pop(T& value) noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_.load(std::memory_order_acquire)) return false;
    value = ring_[head & (kSize - 1)];
    head_.store(head + 1, std::memory_order_release);
    return true;
  }

 private:
  // Two 64-byte cache lines: processors fetch pairs, and the threads must not share one.
  static constexpr std::size_t kApart = 128;
  std::array<T, kSize> ring_{};
  alignas(kApart) std::atomic<std::size_t> head_{0};
  alignas(kApart) std::atomic<std::size_t> tail_{0};
};

/// Tiles reported to a frame, at most; later frames get the rest.
inline constexpr int kNewsPerFrame = 4;
/// Tiles that a frame misses by name; a frame that misses more asks again.
inline constexpr int kNamedMissing = 16;
/// Slots of the hash table that a look-up passes, at most; it is at most half full, where longer runs than
/// some twenty are not seen.
inline constexpr std::size_t kMaxSlotsPassed = 128;

/// Where the hand is, for the loader.
struct LoaderAim {
  /// Voxels; nowhere at first.
  Vec3 hip = Vec3::Constant(std::numeric_limits<double>::infinity());
  Vec3 god_object = Vec3::Zero();                      ///< voxels; the HIP when free
  Vec3 per_frame = Vec3::Zero();                       ///< the HIP's motion in a frame, smoothed
  std::array<std::uint32_t, kNamedMissing> missing{};  ///< numbers of tiles that a frame looked for
  int missing_count = 0;
};

/// Message of the loader to a frame: a tile is at this group now, or shall be forgotten.
struct TileNews {
  std::uint32_t tile = 0;
  std::uint32_t root = 0;  ///< its group in the arena
  static constexpr std::uint32_t kForget = 0xffffffffu;
  /// Group 0 of the arena: empty, the root of every damaged tile.
  static constexpr std::uint32_t kDamaged = 0;
};
/// The frame's answer to kForget, and to a tile that it has no slot for.
struct TileForgotten {
  enum class Why : std::uint8_t { kGone, kKept, kRefused };
  std::uint32_t tile = 0;
  Why why = Why::kGone;  ///< kKept: the god object is in it
};

/// The frame's thread owns it, but for `nodes()`, the rings and the aim, which it shares with one loader.
class TileWindow {
 public:
  static constexpr std::size_t kRing = 256;

  /// `keys` of all tiles by first_code(), and the bricks above them in a grid of their own (see above()).
  /// Allocates all that frames need: `most_tiles` at once and `groups` of nodes.
  TileWindow(std::vector<TileKey> keys, std::size_t most_tiles, std::size_t groups);

  /// As BrickGrid::find; `above`: the brick above the tiles at the place, or none. Notes a tile that exists
  /// and is not here. At most search::kMortonBits nodes and depths_ slots.
  [[nodiscard]] BrickGrid::BrickRef find(const BrickGrid& grid, const Vec3& at,
                                         BrickGrid::BrickRef above) const noexcept;

  /// Takes news, at most kNewsPerFrame. `held`: the brick of the god object, or null;
  /// its tile stays.
  void take_news(const BrickGrid& grid, const BrickGrid::BrickRef* held) noexcept;
  /// Tells the loader where the hand is, if it has moved, and what was missed since the last call.
  void publish_aim(const Vec3& hip, const Vec3& god_object) noexcept;
  /// Whether find() missed a tile since the last call.
  [[nodiscard]] bool take_missed() noexcept {
    const bool missed = missed_;
    missed_ = false;
    return missed;
  }
  /// Whether every tile that a place and its 26 neighbours at `reach` voxels lie in is here or does not
  /// exist. Asks for those that are not here.
  [[nodiscard]] bool covers(const BrickGrid& grid, const Vec3& at, double reach) const noexcept;
  [[nodiscard]] std::size_t resident() const noexcept { return resident_; }
  /// Damaged tiles that came, and the first of them.
  [[nodiscard]] std::uint64_t damaged() const noexcept { return damaged_; }
  [[nodiscard]] std::uint32_t first_damaged() const noexcept { return first_damaged_; }
  /// The tiles that find() missed since the last publish_aim().
  [[nodiscard]] std::span<const std::uint32_t> missing() const noexcept {
    return std::span(next_.missing).first(static_cast<std::size_t>(next_.missing_count));
  }
  /// Names tiles as missed, at most kNamedMissing.
  void ask_for(std::span<const std::uint32_t> tiles) noexcept {
    for (const std::uint32_t tile : tiles) note_missing(tile);
    missed_ = false;
  }
  [[nodiscard]] bool all_here(std::span<const std::uint32_t> tiles) const noexcept {
    for (const std::uint32_t tile : tiles)
      if (root_of(tile) == TileNews::kForget) return false;
    return true;
  }

  // For the loader.
  [[nodiscard]] const std::vector<TileKey>& keys() const noexcept { return keys_; }
  [[nodiscard]] std::span<TileNode> nodes() noexcept { return nodes_; }
  [[nodiscard]] std::size_t node_bytes() const noexcept { return nodes_.capacity() * sizeof(TileNode); }
  [[nodiscard]] std::size_t most_tiles() const noexcept { return most_; }
  SpscRing<TileNews, kRing> news;
  SpscRing<TileForgotten, kRing> forgotten;
  TripleBuffer<LoaderAim> aim;

  static constexpr std::uint32_t kNoTile = 0xffffffffu;
  /// The tile of a place of depth kMortonBits, or kNoTile. O(log tiles); allocates nothing.
  [[nodiscard]] std::uint32_t tile_of(std::uint64_t first_code) const noexcept;

 private:
  struct Slot {
    std::uint32_t tile = kNoTile;
    std::uint32_t root = 0;
  };
  [[nodiscard]] std::size_t home(std::uint32_t tile) const noexcept {
    return static_cast<std::size_t>((tile * kGolden64) >> shift_);
  }
  /// The tile's root group, or kForget if it is not here.
  [[nodiscard]] std::uint32_t root_of(std::uint32_t tile) const noexcept;
  bool insert(std::uint32_t tile, std::uint32_t root) noexcept;
  void erase(std::uint32_t tile) noexcept;
  void note_missing(std::uint32_t tile) const noexcept;

  std::vector<TileKey> keys_;
  std::vector<std::uint64_t> first_codes_;
  std::vector<TileNode> nodes_;
  std::vector<Slot> slots_;
  std::size_t mask_ = 0;
  int shift_ = 0;
  std::size_t resident_ = 0, most_ = 0;
  std::uint64_t damaged_ = 0;
  std::uint32_t first_damaged_ = kNoTile;
  // The tile found last, in which most look-ups end.
  mutable std::uint64_t last_first_ = 1, last_past_ = 0;
  mutable std::uint32_t last_tile_ = kNoTile, last_root_ = 0;
  mutable bool missed_ = false;
  mutable LoaderAim next_;
  Vec3 last_hip_ = Vec3::Zero();
};

}  // namespace palpate::spline_sdf
