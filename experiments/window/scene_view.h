// The scene as the window draws it: its points, their colours, and what is near the god object. What takes
// long (normals, neighbours, errors, stars) is found beside the window and shown when it is there.
#pragma once

#include <chrono>
#include <cstdint>
#include <future>
#include <memory>
#include <optional>
#include <vector>

#include "experiments/window/dent_view.h"
#include "experiments/window/link.h"
#include "experiments/window/overlay.h"
#include "experiments/window/splats.h"
#include "toolkit/partition/uniform_grid.h"
#include "toolkit/stars/star_mesh.h"

namespace palpate::experiments {

/// What is drawn on request about the place that is touched.
struct NearChoice {
  bool neighbours = false, boxes = false, facets = false;
  bool cells = false;  ///< of the uniform grid, from the god object to the HIP
  [[nodiscard]] bool any() const noexcept { return neighbours || boxes || facets || cells; }
};

/// The window's thread alone. Futures that are not ready are waited for by the destructor.
class SceneView {
 public:
  explicit SceneView(std::unique_ptr<SplatDrawer> splats) : splats_(std::move(splats)) {}

  /// Replaces what is shown. O(points).
  void show(std::shared_ptr<const ShownScene> scene);
  [[nodiscard]] const ShownScene* scene() const noexcept { return scene_.get(); }
  [[nodiscard]] const geometry::Aabb& box_mm() const noexcept { return box_mm_; }
  [[nodiscard]] double radius_mm() const noexcept { return 0.5 * box_mm_.extent_mm().norm(); }

  void colour(ColourBy by);
  [[nodiscard]] ColourBy coloured() const noexcept { return colour_; }
  [[nodiscard]] const ColourScale& scale() const noexcept { return scale_; }
  [[nodiscard]] bool has_normals() const noexcept { return has_normals_; }
  /// What is still being found; empty: nothing.
  [[nodiscard]] const char* awaited() const noexcept;

  /// Takes what has become ready; moving models go where the tick says.
  void update(const WatchedTick* now);
  /// Points that gave way stand where they are now: takes an answer, asks again. Does nothing for models that
  /// do not give way.
  void follow_dents(WindowFeed& feed, const WatchedTick& now);
  /// How many points stand elsewhere than they were read.
  [[nodiscard]] std::size_t shifted() const noexcept;
  void draw_near(const Overlay& overlay, const WatchedTick& now, const NearChoice& choice);
  /// What stands at a pixel, in the nearest point's plane: a splat is flat, stands back, and is larger where
  /// points are few. As the splat has it while the neighbours are not known yet.
  [[nodiscard]] Hit on_surface(const Hit& hit, const Vec3& eye_mm);
  [[nodiscard]] SplatDrawer& splats() noexcept { return *splats_; }
  [[nodiscard]] const SplatDrawer& splats() const noexcept { return *splats_; }

 private:
  struct Model {
    std::vector<std::uint32_t> order;
    geometry::RigidTransform world_from_model;
    std::shared_ptr<const Surroundings> known;
    std::shared_ptr<const stars::StarMesh> stars;
    std::vector<std::uint32_t> star_place;  // of the cloud's points
    std::uint32_t nearest = 0;              // the last one found
    std::shared_ptr<const partition::UniformGrid> grid;
    DentView dents;
    std::vector<std::uint32_t> index_of;  // in `order`; empty where the model does not give way
  };
  struct Coloured {
    ColourScale scale;
    std::vector<std::vector<Rgba>> of;
  };
  template <class T>
  static bool ready(const std::future<T>& future) {
    return future.valid() && future.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
  }
  void take_surroundings();
  void ask_stars(std::size_t model);
  [[nodiscard]] std::optional<std::uint32_t> nearest(std::size_t model, const Vec3& local_mm);
  void ask_grid(std::size_t model);
  void draw_cells(const Overlay& overlay, const Model& model, const cloud::Cloud& cloud,
                  const WatchedTick& now) const;
  void draw_facets(const Overlay& overlay, const Model& model, std::uint32_t point) const;

  std::unique_ptr<SplatDrawer> splats_;
  std::shared_ptr<const ShownScene> scene_;
  geometry::Aabb box_mm_;
  std::vector<Model> models_;
  ColourBy colour_ = ColourBy::kPlain;
  ColourScale scale_;
  bool has_normals_ = false;
  std::future<Coloured> colours_;
  std::future<std::vector<std::shared_ptr<const Surroundings>>> surroundings_;
  std::future<std::shared_ptr<const stars::StarMesh>> stars_;
  std::size_t stars_of_ = 0;
  std::future<std::shared_ptr<const partition::UniformGrid>> grid_;
  std::size_t grid_of_ = 0;
  std::size_t asks_ = 0;  // models that give way are asked about in turn
};

}  // namespace palpate::experiments
