#include "toolkit/spline_sdf/tile_window.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

namespace palpate::spline_sdf {
namespace {

/// Share of the newest motion in the smoothed one: a mean over some 16 frames.
constexpr double kNewestShare = 1.0 / 16.0;
/// A HIP that moves farther in a frame, in voxels, was set down elsewhere.
constexpr double kSetDown = 64.0;
/// Voxels that the HIP moves before the loader hears of it, two of the smallest tile's bricks: telling takes
/// a frame a tenth of its time.
constexpr double kToldAgain = 8.0;

/// The code of depth kMortonBits of a place inside the grid; false outside.
bool code_of(const BrickGrid& grid, const Vec3& at, std::uint64_t& code) noexcept {
  const double per = grid.per_voxel_of(grid.levels - 1) * (1.0 / kBrickCells);
  std::array<std::uint32_t, 3> cube{};
  for (std::size_t a = 0; a < 3; ++a) {
    const double x = std::floor(at[static_cast<Eigen::Index>(a)] * per);
    if (!(x >= 0.0 && x <= static_cast<double>(((grid.last_brick + 1) << (grid.levels - 1)) - 1)))
      return false;
    cube[a] = static_cast<std::uint32_t>(x);
  }
  code = search::morton_code(cube[0], cube[1], cube[2]);
  return true;
}

BrickGrid::Coordinate cube_of(std::uint64_t code, int depth) noexcept {
  return search::coordinate_of_code(code >> (3 * (search::kMortonBits - depth)));
}

std::uint64_t first_code_of(const BrickGrid& grid, const BrickGrid::BrickRef& place) noexcept {
  const std::uint64_t code = search::morton_code(static_cast<std::uint32_t>(place.cube[0]),
                                                 static_cast<std::uint32_t>(place.cube[1]),
                                                 static_cast<std::uint32_t>(place.cube[2]));
  return TileKey{code, depth_of_level(grid, place.level)}.first_code();
}

}  // namespace

BrickGrid::BrickRef BrickGrid::find_in_window(const Vec3& at) const noexcept {
  const BrickRef above = find_in_tables(at);
  return above.brick != kNone && above.whole ? above : window->find(*this, at, above);
}

TileWindow::TileWindow(std::vector<TileKey> keys, std::size_t most_tiles, std::size_t groups)
    : keys_(std::move(keys)), nodes_(groups * kGroupNodes), most_(std::max<std::size_t>(most_tiles, 1)) {
  first_codes_.reserve(keys_.size());
  for (const TileKey& key : keys_) first_codes_.push_back(key.first_code());
  const std::size_t slots = std::bit_ceil(2 * most_);
  slots_.resize(slots);
  mask_ = slots - 1;
  shift_ = 64 - std::countr_zero(slots);
}

std::uint32_t TileWindow::tile_of(std::uint64_t first_code) const noexcept {
  const auto after = std::upper_bound(first_codes_.begin(), first_codes_.end(), first_code);
  if (after == first_codes_.begin()) return kNoTile;
  const auto tile = static_cast<std::size_t>(after - first_codes_.begin()) - 1;
  const TileKey key = keys_[tile];
  const int below = 3 * (search::kMortonBits - key.depth);
  return first_code >> below == key.code ? static_cast<std::uint32_t>(tile) : kNoTile;
}

BrickGrid::BrickRef TileWindow::find(const BrickGrid& grid, const Vec3& at,
                                     BrickGrid::BrickRef above) const noexcept {
  std::uint64_t code = 0;
  if (!code_of(grid, at, code)) return above;
  if (!(code >= last_first_ && code < last_past_)) {
    const std::uint32_t tile = tile_of(code);
    if (tile == kNoTile) return above;
    const std::uint32_t root = root_of(tile);
    if (root == TileNews::kForget) {
      note_missing(tile);
      return above;
    }
    const TileKey key = keys_[tile];
    last_first_ = key.first_code();
    last_past_ = TileKey{key.code + 1, key.depth}.first_code();
    last_tile_ = tile;
    last_root_ = root;
  }
  BrickGrid::BrickRef out = above;
  const int first_depth = depth_of_level(grid, 0);
  const TileNode* node = &nodes_[std::size_t{last_root_} * kGroupNodes];
  for (int depth = keys_[last_tile_].depth;; ++depth) {
    if (depth >= first_depth) {
      if (node->brick == BrickGrid::kNone) return out;
      out = {node->brick, depth - first_depth, cube_of(code, depth), node->children == 0};
    }
    if (node->children == 0) return out;
    const std::uint64_t child = code >> (3 * (search::kMortonBits - depth - 1)) & (kGroupNodes - 1);
    node = &nodes_[std::size_t{node->children} * kGroupNodes + child];
  }
}

std::uint32_t TileWindow::root_of(std::uint32_t tile) const noexcept {
  for (std::size_t i = home(tile), passed = 0; passed < kMaxSlotsPassed; ++passed, i = (i + 1) & mask_) {
    if (slots_[i].tile == tile) return slots_[i].root;
    if (slots_[i].tile == kNoTile) break;
  }
  return TileNews::kForget;
}

bool TileWindow::insert(std::uint32_t tile, std::uint32_t root) noexcept {
  if (resident_ == most_) return false;
  for (std::size_t i = home(tile), passed = 0; passed < kMaxSlotsPassed; ++passed, i = (i + 1) & mask_) {
    if (slots_[i].tile != kNoTile) continue;
    slots_[i] = {tile, root};
    ++resident_;
    return true;
  }
  return false;
}

void TileWindow::erase(std::uint32_t tile) noexcept {
  std::size_t hole = home(tile);
  for (std::size_t passed = 0; slots_[hole].tile != tile; hole = (hole + 1) & mask_)
    if (slots_[hole].tile == kNoTile || ++passed == kMaxSlotsPassed) return;
  --resident_;
  if (tile == last_tile_) last_first_ = 1, last_past_ = 0;
  // Followers in the run move back where the hole would hide them.
  for (std::size_t i = (hole + 1) & mask_; slots_[i].tile != kNoTile; i = (i + 1) & mask_) {
    if (((i - home(slots_[i].tile)) & mask_) < ((i - hole) & mask_)) continue;
    slots_[hole] = slots_[i];
    hole = i;
  }
  slots_[hole] = {};
}

void TileWindow::note_missing(std::uint32_t tile) const noexcept {
  missed_ = true;
  const auto named = std::span(next_.missing).first(static_cast<std::size_t>(next_.missing_count));
  if (next_.missing_count < kNamedMissing && std::find(named.begin(), named.end(), tile) == named.end())
    next_.missing[static_cast<std::size_t>(next_.missing_count++)] = tile;
}

void TileWindow::take_news(const BrickGrid& grid, const BrickGrid::BrickRef* held) noexcept {
  TileNews one;
  for (int i = 0; i < kNewsPerFrame && news.pop(one); ++i) {
    if (one.root != TileNews::kForget) {
      if (one.root == TileNews::kDamaged && damaged_++ == 0) first_damaged_ = one.tile;
      // No place left is answered as forgotten: the loader takes the tile's memory back.
      if (!insert(one.tile, one.root))
        static_cast<void>(forgotten.push({one.tile, TileForgotten::Why::kRefused}));
      continue;
    }
    const bool kept =
        held != nullptr && held->brick != BrickGrid::kNone && tile_of(first_code_of(grid, *held)) == one.tile;
    if (!kept) erase(one.tile);
    // The ring holds as many answers as there can be news.
    static_cast<void>(
        forgotten.push({one.tile, kept ? TileForgotten::Why::kKept : TileForgotten::Why::kGone}));
  }
}

void TileWindow::publish_aim(const Vec3& hip, const Vec3& god_object) noexcept {
  const Vec3 moved = hip - last_hip_;
  last_hip_ = hip;
  next_.per_frame = moved.squaredNorm() < kSetDown * kSetDown
                        ? Vec3(next_.per_frame + (moved - next_.per_frame) * kNewestShare)
                        : Vec3(Vec3::Zero());
  if (next_.missing_count == 0 && (hip - next_.hip).squaredNorm() < kToldAgain * kToldAgain) return;
  next_.hip = hip;
  next_.god_object = god_object;
  aim.publish(next_);
  next_.missing_count = 0;
}

bool TileWindow::covers(const BrickGrid& grid, const Vec3& at, double reach) const noexcept {
  const bool missed = missed_;
  bool all = true;
  for (int k = 0; k < 27; ++k) {
    const Vec3 place = at + reach * Vec3(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
    std::uint64_t code = 0;
    if (!code_of(grid, place, code)) continue;
    const std::uint32_t tile = tile_of(code);
    if (tile == kNoTile || root_of(tile) != TileNews::kForget) continue;
    note_missing(tile);
    all = false;
  }
  missed_ = missed;
  return all;
}

}  // namespace palpate::spline_sdf
