// A surface of tiles, loaded near the hand. A loader thread reads them ahead of the HIP's motion into memory
// that was allocated before; frames never wait, but for replays that ask for it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <thread>
#include <vector>

#include "toolkit/spline_sdf/surface_file.h"
#include "toolkit/spline_sdf/tile_window.h"

namespace palpate::spline_sdf {

/// Bytes in memory unless asked otherwise (resident_mb): a hand at 0.5 m/s crosses them in several seconds.
inline constexpr std::size_t kResidentBytes = std::size_t{256} << 20;
/// Bytes below which a window is refused: some twenty full tiles. A frame of a hand looks at a few.
inline constexpr std::size_t kLeastResidentBytes = std::size_t{16} << 20;

/// The brick that contact holds: its tile must stay.
struct HeldBrick {
  Vec3 god_object = Vec3::Zero();  ///< voxels
  BrickGrid::BrickRef place;
};

/// Frame calls from one thread. The grid has the window in it; it looks up like one that is whole in memory.
class PagedSurface {
 public:
  /// Starts the loader. `resident_bytes` bounds bricks and nodes in memory, which are written once here, so
  /// that no frame meets a page for the first time. Errors: less than kLeastResidentBytes.
  [[nodiscard]] static Result<std::unique_ptr<PagedSurface>> start(std::shared_ptr<const SurfaceFile> file,
                                                                   std::size_t surface,
                                                                   std::size_t resident_bytes);
  ~PagedSurface();
  PagedSurface(const PagedSurface&) = delete;
  PagedSurface& operator=(const PagedSurface&) = delete;

  [[nodiscard]] const BrickGrid& grid() const noexcept { return grid_; }
  [[nodiscard]] double spacing_mm() const noexcept { return stored().surface.spacing_mm; }
  [[nodiscard]] const StoredSurface& stored() const noexcept { return file_->surfaces()[surface_]; }
  [[nodiscard]] std::size_t bytes() const noexcept;
  /// Whether the memory is locked: else a page may have been swapped out.
  [[nodiscard]] bool locked() const noexcept { return locked_; }

  /// Before a frame: takes messages and gives the loader the hand's place, voxels. `held`: null when free.
  /// Bounded, wait-free.
  void begin_frame(const Vec3& hip, const HeldBrick* held) noexcept;
  /// Whether a look-up since the last call missed a tile of the file.
  [[nodiscard]] bool take_missed() noexcept { return window_.take_missed(); }
  [[nodiscard]] bool covers(const Vec3& at, double reach) const noexcept {
    return window_.covers(grid_, at, reach);
  }
  [[nodiscard]] const TileWindow& window() const noexcept { return window_; }
  /// For replays: waits until the tiles that were missed are here, or damaged. False after kLongestWait.
  bool wait_for_missed(const Vec3& hip, const HeldBrick* held) noexcept;

 private:
  /// `most`: the largest tile; none where all fit.
  PagedSurface(std::shared_ptr<const SurfaceFile> file, std::size_t surface, TileSize all, TileSize most);
  void load_until(const std::stop_token& stop);
  bool poll();
  void take_forgotten();
  void choose_wanted();
  void collect(TileKey node, std::size_t first, std::size_t past);
  [[nodiscard]] double distance_to(TileKey node) const noexcept;
  /// False if there is no room yet.
  bool load(std::uint32_t tile);
  bool read(std::uint32_t tile);
  [[nodiscard]] bool has_room(TileSize size) const noexcept;
  void keep_spare();
  void release(std::uint32_t tile);

  std::shared_ptr<const SurfaceFile> file_;
  std::size_t surface_;
  TileSize all_, spare_;  ///< memory, and what shall be free of it: nothing where every tile fits at once
  BrickGrid grid_;
  TileWindow window_;
  bool locked_ = false;

  // The loader's own.
  enum class State : std::uint8_t { kAbsent, kHere, kLeaving };
  struct Wanted {
    std::uint32_t tile = 0;
    double distance = 0.0;
  };
  struct Held {
    std::uint32_t tile = 0;
    std::vector<std::uint32_t> groups, bricks;
  };
  std::vector<State> state_;
  std::vector<std::uint32_t> held_of_;  ///< by tile: its place in held_
  std::vector<Held> held_;
  std::vector<std::uint32_t> free_groups_, free_bricks_;
  std::vector<Wanted> wanted_;
  std::vector<Vec3> goals_;
  LoaderAim aim_;
  Vec3 chosen_at_ = Vec3::Zero();
  bool chosen_ = false;
  double radius_ = 0.0;
  std::size_t leaving_ = 0, wanted_at_ = 0;
  SurfaceFile::TileBuffer buffer_;

  std::jthread loader_;  ///< last: it uses all above
};

}  // namespace palpate::spline_sdf
