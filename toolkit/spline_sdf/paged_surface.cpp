#include "toolkit/spline_sdf/paged_surface.h"

#include <fmt/format.h>
#include <sys/mman.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

namespace palpate::spline_sdf {
namespace {

using std::chrono::microseconds;

/// A hand at 0.5 m/s goes a tenth of a millimetre in this time: less than the smallest tile.
constexpr microseconds kPause{200};
/// Times by which the loader looks ahead of the HIP, frames: a tenth of a second, in which an SSD reads 20
/// MB.
constexpr std::array<double, 3> kAheadFrames{25.0, 50.0, 100.0};
/// Tiles loaded between two reads of the hand's place: some 2 ms of unpacking.
constexpr int kLoadsPerPoll = 4;
/// Tiles that are requested to leave at once.
constexpr std::size_t kMostLeaving = TileWindow::kRing / 2;
/// The wanted tiles fill this share of the memory; the rest lets old ones stay and new ones come.
constexpr double kWantedShare = 0.6, kWantedLeast = 0.4;
constexpr double kGrow = 1.2;
/// The wanted tiles are chosen anew when the HIP has gone this share of the radius.
constexpr double kChooseAgain = 0.05;
/// A disk that does not answer in this time is taken for absent.
constexpr std::chrono::seconds kLongestWait{5};
/// Radius to begin with, in the edges of the largest bricks.
constexpr double kFirstRadius = 8.0;
/// Memory for groups over what the file's mean tile needs: parts of a surface differ.
constexpr double kSpareGroups = 1.25;
/// Share of the memory that is kept free for tiles to come: at 0.5 m/s over 0.1 mm spacing, a tenth of a
/// second's.
constexpr double kSpareShare = 0.125;

struct TileSums {
  double groups = 0.0, bricks = 0.0;
  TileSize most;
};
TileSums sums_of(const StoredSurface& stored) {
  TileSums sums;
  for (const StoredSurface::Place& place : stored.places) {
    sums.groups += place.size.groups;
    sums.bricks += place.size.bricks;
    sums.most = {std::max(sums.most.groups, place.size.groups),
                 std::max(sums.most.bricks, place.size.bricks)};
  }
  return sums;
}

}  // namespace

Result<std::unique_ptr<PagedSurface>> PagedSurface::start(std::shared_ptr<const SurfaceFile> file,
                                                          std::size_t surface, std::size_t resident_bytes) {
  if (resident_bytes < kLeastResidentBytes)
    return Error{fmt::format("{} bytes are too few to hold what one frame needs", resident_bytes),
                 fmt::format("give at least {} MB", kLeastResidentBytes >> 20), file->path()};
  const TileSums sums = sums_of(file->surfaces()[surface]);
  const double groups_per_brick = sums.bricks > 0.0 ? sums.groups / sums.bricks : 1.0;
  const double of_brick = sizeof(Brick) + kSpareGroups * groups_per_brick * kGroupNodes * sizeof(TileNode);
  // A surface that is smaller than the window takes only what it needs.
  const double share =
      std::min(static_cast<double>(resident_bytes) / of_brick / std::max(sums.bricks, 1.0), 1.0);
  const auto bricks = static_cast<std::uint32_t>(std::ceil(share * sums.bricks));
  const auto groups =
      static_cast<std::uint32_t>(std::ceil(std::min(kSpareGroups * share, 1.0) * sums.groups)) +
      sums.most.groups + 1;
  return std::unique_ptr<PagedSurface>(
      new PagedSurface(std::move(file), surface, {groups, bricks}, share < 1.0 ? sums.most : TileSize{}));
}

PagedSurface::PagedSurface(std::shared_ptr<const SurfaceFile> file, std::size_t surface, TileSize all,
                           TileSize most)
    : file_(std::move(file)),
      surface_(surface),
      all_(all),
      grid_(stored().surface.grid),
      window_(stored().keys, std::min<std::size_t>(stored().keys.size(), all.bricks), all.groups) {
  const std::size_t above = grid_.bricks.size();
  grid_.bricks.resize(above + all.bricks);
  grid_.window = &window_;
  state_.assign(stored().keys.size(), State::kAbsent);
  held_of_.assign(stored().keys.size(), 0);
  for (std::size_t b = grid_.bricks.size(); b-- > above;)
    free_bricks_.push_back(static_cast<std::uint32_t>(b));
  for (std::size_t g = all.groups; g-- > TileNews::kDamaged + 1;)
    free_groups_.push_back(static_cast<std::uint32_t>(g));
  radius_ = kFirstRadius * grid_.cube_edge();
  // Half of it holds any tile.
  const auto spare = [](std::uint32_t all_of, std::uint32_t most_of) {
    return std::max(static_cast<std::uint32_t>(kSpareShare * all_of), 2 * most_of);
  };
  if (most.bricks > 0) spare_ = {spare(all.groups, most.groups), spare(all.bricks, most.bricks)};
  const std::span<TileNode> nodes = window_.nodes();
  // The loader's first write into a page brings it; to have all at once would take most of the opening.
  locked_ = ::mlock2(grid_.bricks.data(), grid_.bricks.size() * sizeof(Brick), MLOCK_ONFAULT) == 0 &&
            ::mlock(nodes.data(), nodes.size_bytes()) == 0;
  loader_ = std::jthread([this](const std::stop_token& stop) { load_until(stop); });
}

PagedSurface::~PagedSurface() {
  // Locked memory stays locked until it is unmapped: locks do not nest, and the session may hold its own.
  loader_.request_stop();
  loader_.join();
}

std::size_t PagedSurface::bytes() const noexcept {
  return grid_.bytes() + window_.node_bytes() +
         stored().keys.size() * (sizeof(TileKey) + sizeof(std::uint64_t));
}

// --- the frame's side

void PagedSurface::begin_frame(const Vec3& hip, const HeldBrick* held) noexcept {
  window_.take_news(grid_, held != nullptr ? &held->place : nullptr);
  window_.publish_aim(hip, held != nullptr ? held->god_object : hip);
}

bool PagedSurface::wait_for_missed(const Vec3& hip, const HeldBrick* held) noexcept {
  std::array<std::uint32_t, kNamedMissing> named{};
  const std::span<const std::uint32_t> missing = window_.missing();
  std::copy(missing.begin(), missing.end(), named.begin());
  const auto tiles = std::span<const std::uint32_t>(named).first(missing.size());
  const auto until = std::chrono::steady_clock::now() + kLongestWait;
  for (;;) {
    window_.ask_for(tiles);
    begin_frame(hip, held);
    if (window_.all_here(tiles)) return true;
    if (std::chrono::steady_clock::now() > until) return false;
    std::this_thread::sleep_for(kPause / 4);
  }
}

// --- the loader's side

void PagedSurface::load_until(const std::stop_token& stop) {
  while (!stop.stop_requested())
    if (!poll()) std::this_thread::sleep_for(kPause);
}

bool PagedSurface::poll() {
  take_forgotten();
  const bool moved = window_.aim.acquire();
  if (moved) {
    aim_ = window_.aim.front();
    for (int i = 0; i < aim_.missing_count; ++i) {
      const std::uint32_t tile = aim_.missing[static_cast<std::size_t>(i)];
      if (state_[tile] == State::kAbsent) static_cast<void>(load(tile));
    }
    if (!chosen_ || (aim_.hip - chosen_at_).norm() > kChooseAgain * radius_) choose_wanted();
  }
  if (!chosen_) return false;
  keep_spare();
  int loads = 0;
  while (wanted_at_ < wanted_.size() && loads < kLoadsPerPoll) {
    const Wanted& next = wanted_[wanted_at_];
    if (state_[next.tile] == State::kAbsent) {
      if (!load(next.tile)) break;
      ++loads;
    }
    ++wanted_at_;
  }
  return loads > 0;
}

void PagedSurface::take_forgotten() {
  TileForgotten one;
  while (window_.forgotten.pop(one)) {
    // A tile that was refused and then requested to leave is answered twice; the second answer counts.
    const bool leaving = state_[one.tile] == State::kLeaving;
    if (state_[one.tile] == State::kAbsent || (leaving && one.why == TileForgotten::Why::kRefused)) continue;
    if (leaving) --leaving_;
    if (one.why == TileForgotten::Why::kKept)
      state_[one.tile] = State::kHere;
    else
      release(one.tile);
  }
}

void PagedSurface::release(std::uint32_t tile) {
  const std::uint32_t at = held_of_[tile];
  Held& held = held_[at];
  free_groups_.insert(free_groups_.end(), held.groups.begin(), held.groups.end());
  free_bricks_.insert(free_bricks_.end(), held.bricks.begin(), held.bricks.end());
  if (at + 1 != held_.size()) {
    held = std::move(held_.back());
    held_of_[held.tile] = at;
  }
  held_.pop_back();
  state_[tile] = State::kAbsent;
  // Tiles that left may be wanted again.
  wanted_at_ = 0;
}

double PagedSurface::distance_to(TileKey node) const noexcept {
  const BrickGrid::Coordinate cube = search::coordinate_of_code(node.code);
  const double edge = node_edge(grid_, node.depth);
  const Vec3 low = edge * Vec3(cube[0], cube[1], cube[2]), high = low + Vec3::Constant(edge);
  double least_sq = std::numeric_limits<double>::max();
  for (const Vec3& goal : goals_)
    least_sq = std::min(least_sq, (goal.cwiseMax(low).cwiseMin(high) - goal).squaredNorm());
  return std::sqrt(least_sq);
}

void PagedSurface::collect(TileKey node, std::size_t first, std::size_t past) {
  if (first == past) return;
  const double distance = distance_to(node);
  if (distance > radius_) return;
  const std::vector<TileKey>& keys = window_.keys();
  if (past - first == 1) {
    const double own = distance_to(keys[first]);
    if (own <= radius_) wanted_.push_back({static_cast<std::uint32_t>(first), own});
    return;
  }
  for (std::uint64_t k = 0; k < kGroupNodes; ++k) {
    const TileKey child{node.code << 3 | k, node.depth + 1};
    const std::uint64_t next = TileKey{child.code + 1, child.depth}.first_code();
    const auto end = std::lower_bound(
        keys.begin() + static_cast<std::ptrdiff_t>(first), keys.begin() + static_cast<std::ptrdiff_t>(past),
        next, [](const TileKey& key, std::uint64_t code) { return key.first_code() < code; });
    const auto at = static_cast<std::size_t>(end - keys.begin());
    collect(child, first, at);
    first = at;
  }
}

void PagedSurface::choose_wanted() {
  goals_ = {aim_.hip, aim_.god_object};
  for (const double frames : kAheadFrames) goals_.push_back(aim_.hip + frames * aim_.per_frame);
  chosen_at_ = aim_.hip;
  chosen_ = true;
  wanted_at_ = 0;
  const double whole = node_edge(grid_, 0);
  for (int tries = 0;; ++tries) {
    wanted_.clear();
    collect({}, 0, window_.keys().size());
    double bricks = 0.0, groups = 0.0;
    for (const Wanted& one : wanted_) {
      bricks += stored().places[one.tile].size.bricks;
      groups += stored().places[one.tile].size.groups;
    }
    const double share = std::max(bricks / all_.bricks, groups / all_.groups);
    // The radius follows the memory, a step at a time; far too large it is made smaller at once.
    if (share > kWantedShare && wanted_.size() > 1) {
      radius_ /= kGrow;
      constexpr int kTries = 64;
      if (tries < kTries) continue;
    } else if (share < kWantedLeast && radius_ < whole) {
      radius_ *= kGrow;
    }
    break;
  }
  std::sort(wanted_.begin(), wanted_.end(), [](const Wanted& a, const Wanted& b) {
    return std::pair(a.distance, a.tile) < std::pair(b.distance, b.tile);
  });
}

bool PagedSurface::has_room(TileSize size) const noexcept {
  return free_bricks_.size() >= size.bricks && free_groups_.size() >= size.groups;
}

/// Memory comes back when frames have answered: what is far leaves before it is needed.
void PagedSurface::keep_spare() {
  if (has_room({spare_.groups / 2, spare_.bricks / 2})) return;
  TileSize coming{static_cast<std::uint32_t>(free_groups_.size()),
                  static_cast<std::uint32_t>(free_bricks_.size())};
  const auto count = [&](const Held& held) {
    coming.groups += static_cast<std::uint32_t>(held.groups.size());
    coming.bricks += static_cast<std::uint32_t>(held.bricks.size());
  };
  std::vector<Wanted> far;
  for (const Held& held : held_)
    if (state_[held.tile] == State::kLeaving)
      count(held);
    else
      far.push_back({held.tile, distance_to(window_.keys()[held.tile])});
  std::sort(far.begin(), far.end(), [](const Wanted& a, const Wanted& b) {
    return std::pair(a.distance, a.tile) > std::pair(b.distance, b.tile);
  });
  for (const Wanted& one : far) {
    if (coming.groups >= spare_.groups && coming.bricks >= spare_.bricks) break;
    if (leaving_ == kMostLeaving || !window_.news.push({one.tile, TileNews::kForget})) break;
    state_[one.tile] = State::kLeaving;
    ++leaving_;
    count(held_[held_of_[one.tile]]);
  }
}

bool PagedSurface::load(std::uint32_t tile) {
  const TileSize& size = stored().places[tile].size;
  if (window_.news.full() || !has_room(size)) return false;
  Held held;
  held.tile = tile;
  std::uint32_t root = TileNews::kDamaged;
  if (read(tile)) {
    held.groups.assign(free_groups_.end() - size.groups, free_groups_.end());
    held.bricks.assign(free_bricks_.end() - size.bricks, free_bricks_.end());
    free_groups_.resize(free_groups_.size() - held.groups.size());
    free_bricks_.resize(free_bricks_.size() - held.bricks.size());
    const UnpackedTile& unpacked = buffer_.tile;
    for (std::size_t i = 0; i < unpacked.nodes.size(); ++i) {
      TileNode node = unpacked.nodes[i];
      if (node.brick != BrickGrid::kNone) node.brick = held.bricks[node.brick];
      if (node.children != 0) node.children = held.groups[node.children];
      window_.nodes()[std::size_t{held.groups[i / kGroupNodes]} * kGroupNodes + i % kGroupNodes] = node;
    }
    for (std::size_t b = 0; b < unpacked.bricks.size(); ++b)
      grid_.bricks[held.bricks[b]] = unpacked.bricks[b];
    root = held.groups.front();
  }
  static_cast<void>(window_.news.push({tile, root}));  // it is not full
  state_[tile] = State::kHere;
  held_of_[tile] = static_cast<std::uint32_t>(held_.size());
  held_.push_back(std::move(held));
  return true;
}

/// Reads a tile; false where it is damaged. Memory that cannot be had is damage too: the thread goes
/// on.
bool PagedSurface::read(std::uint32_t tile) {
  try {
    return file_->read_tile(surface_, tile, buffer_).ok();
  } catch (const std::exception&) {
    return false;
  }
}

}  // namespace palpate::spline_sdf
