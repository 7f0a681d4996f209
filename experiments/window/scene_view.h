// The drawn scene: points, colours, and the god object's neighbourhood. Slow parts (normals, neighbours,
// errors, stars) are computed in the background.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <future>
#include <memory>
#include <optional>
#include <span>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/device/device.h>
#include <palpate/geometry.h>
#include <palpate/result.h>
#include "experiments/window/camera.h"
#include "experiments/window/link.h"
#include "experiments/window/overlay.h"
#include "experiments/window/splat_points.h"
#include "toolkit/local_delaunay/local_delaunay_mesh.h"
#include "toolkit/search/neighbour_table.h"
#include "toolkit/search/uniform_grid.h"

namespace palpate::experiments {

// Draws a cloud progressively into a kept picture. Each frame adds points; the picture restarts only when
// camera or model moves, so the window stays quick for any number of points.
//
// A frame's points are a prefix of a random order: an even sample. Splats shrink as their number grows;
// early, large ones lie back by half their size, so later, small ones win. The number of points a frame
// follows from earlier frames' times.

/// The surface at a pixel of the kept picture.
struct Hit {
  Vec3 place_mm = Vec3::Zero();  ///< world frame
  Vec3 normal = Vec3::Zero();    ///< unit, world frame, towards the eye; zero if unknown
};

/// One thread with a current OpenGL context (3.3 core) from construction to destruction.
class SplatDrawer {
 public:
  /// Error: the graphics driver's message.
  [[nodiscard]] static Result<std::unique_ptr<SplatDrawer>> create();
  ~SplatDrawer();
  SplatDrawer(const SplatDrawer&) = delete;
  SplatDrawer& operator=(const SplatDrawer&) = delete;

  /// Removes all models.
  void clear();
  /// Adds a model and returns its number. Places are from places_in_order(), relative to `origin_mm`.
  std::size_t add(std::span<const float> places, std::span<const Rgba> colours, const Vec3& origin_mm);
  /// Puts other points, camera-fresh and without normals, in a model's place.
  void replace(std::size_t model, std::span<const float> places, std::span<const Rgba> colours,
               const Vec3& origin_mm);
  void recolour(std::size_t model, std::span<const Rgba> colours);
  /// In the same order; empty: unknown.
  void set_normals(std::size_t model, std::span<const PackedNormal> normals);
  /// Moves a model's `index`-th point in the order it was added, relative to its origin.
  void move(std::size_t model, std::size_t index, const Vec3f& place_mm);
  void place(std::size_t model, const geometry::RigidTransform& world_from_model);
  /// Turns shading by normals on or off; on at first.
  void light(bool on);

  /// Continues the picture, or restarts it after a change of camera, size or model. Draws at most
  /// as many points as took() allows.
  void draw(const Camera& camera, int width_px, int height_px);
  /// Copies the kept picture into the default framebuffer.
  void show() const;
  /// Notes the last draw()'s time up to its end on the graphics processor; adapts the next.
  void took(double draw_ms) noexcept;

  [[nodiscard]] std::size_t points() const noexcept { return points_; }
  [[nodiscard]] std::size_t drawn() const noexcept { return drawn_; }
  /// Pictures from the last restart until every point was drawn; 0: unfinished.
  [[nodiscard]] std::size_t whole_after() const noexcept { return whole_after_; }
  /// Number of restarts.
  [[nodiscard]] std::uint64_t begun() const noexcept { return begun_; }

  /// The point nearest to the eye around a pixel, from the kept depth; empty if none.
  [[nodiscard]] std::optional<Hit> at(double x_px, double y_px) const;

 private:
  struct Model;
  struct Target;
  SplatDrawer();
  [[nodiscard]] Status build();
  [[nodiscard]] bool fit(int width_px, int height_px);
  void begin();
  void draw_more();

  std::unique_ptr<Target> target_;
  std::vector<Model> models_;
  unsigned squares_ = 0, discs_ = 0;  // shader programs
  Camera camera_;
  Mat4 clip_from_world_ = Mat4::Identity();
  int width_px_ = 0, height_px_ = 0;
  bool lit_ = true, stale_ = true;
  std::size_t points_ = 0, drawn_ = 0, budget_, last_drawn_ = 0;
  std::size_t pictures_ = 0, whole_after_ = 0;  // since the restart
  double ms_a_point_ = 0.0;
  std::uint64_t begun_ = 0;
};

// Tracks the moved points of a deformable model. The window asks about some points per picture, around the
// touched place and those seen to move; the servo answers between frames.

/// A point that moved since the previous picture.
struct ShiftedPoint {
  std::uint32_t point = 0;  ///< index in the cloud
  Vec3f place_mm = Vec3f::Zero();
};

/// Tracks one model. For the window's thread.
class DentView {
 public:
  /// The next question. It holds points around `touched`, outwards link by link, then in turn those seen to
  /// move and their neighbours, to find a dent's border and its recovery. Empty if nothing is to be asked.
  /// Work bounded by PointQuestion::kMost.
  [[nodiscard]] std::optional<PointQuestion> question(std::uint32_t model,
                                                      const std::optional<std::uint32_t>& touched,
                                                      const search::NeighbourTable& neighbours);
  /// An answer's changes to the picture. An unknown answer puts every point back.
  [[nodiscard]] std::vector<ShiftedPoint> take(const PointAnswer& answer, const cloud::Cloud& cloud);
  /// Number of points away from their read position.
  [[nodiscard]] std::size_t shifted() const noexcept { return moved_.size(); }

 private:
  std::unordered_map<std::uint32_t, Vec3f> moved_;
  std::vector<std::uint32_t> turn_;  // every point that ever moved, asked in turn
  std::unordered_set<std::uint32_t> in_turn_;
  std::size_t next_ = 0;
};

// The mouse as a hand: its goal hovers over the surface under the cursor and presses into it while the button
// is held. Device, servo and governor produce the force as for any hand.

class MouseHand {
 public:
  /// In device mm, like scripted tasks' (TaskSizes), independent of the scene's size.
  static constexpr double kHoverMm = 2.0, kFirstPressMm = 4.0, kLeastPressMm = 0.5, kMostPressMm = 20.0;
  static constexpr double kWheelFactor = 1.15;

  /// The goal, world frame; empty until the cursor has once been over the surface. Off the surface it hovers
  /// in the picture plane through the last place. `hit`: under the cursor.
  [[nodiscard]] std::optional<Vec3> goal_mm(const std::optional<Hit>& hit, const Vec3& ray_place_mm,
                                            const Camera& camera, const device::DeviceMap& map, bool pressed);
  /// Wheel steps while the button is held: change the depth.
  void wheel(double steps) noexcept;
  [[nodiscard]] double press_mm() const noexcept { return press_mm_; }
  /// The last place under the cursor, world frame.
  [[nodiscard]] const std::optional<Hit>& last() const noexcept { return last_; }
  void forget() noexcept { last_.reset(); }

 private:
  double press_mm_ = kFirstPressMm;
  std::optional<Hit> last_;
};

/// Optional drawings around the touched place.
struct NearChoice {
  bool neighbours = false, boxes = false, facets = false;
  bool cells = false;  ///< uniform grid cells from god object to HIP
  [[nodiscard]] bool any() const noexcept { return neighbours || boxes || facets || cells; }
};

/// For the window's thread. The destructor waits for pending futures.
class SceneView {
 public:
  explicit SceneView(std::unique_ptr<SplatDrawer> splats) : splats_(std::move(splats)) {}

  /// Replaces the scene. O(points).
  void show(std::shared_ptr<const ShownScene> scene);
  [[nodiscard]] const ShownScene* scene() const noexcept { return scene_.get(); }
  [[nodiscard]] const geometry::Aabb& box_mm() const noexcept { return box_mm_; }
  [[nodiscard]] double radius_mm() const noexcept { return 0.5 * box_mm_.extent_mm().norm(); }

  void colour(ColourBy by);
  [[nodiscard]] ColourBy coloured() const noexcept { return colour_; }
  [[nodiscard]] const ColourScale& scale() const noexcept { return scale_; }
  /// Name of a pending computation; empty: none.
  [[nodiscard]] const char* awaited() const noexcept;

  /// Takes finished computations and moves models to the tick's poses.
  void update(const WatchedTick* now);
  /// Moves points by the feed's answer and asks again. The call does nothing for rigid models.
  void follow_dents(WindowFeed& feed, const WatchedTick& now);
  /// Puts a stream's image in the place of the first model's points; what is known of these is forgotten.
  void show_image(const ShownImage& image);
  /// Number of points away from their read position.
  [[nodiscard]] std::size_t shifted() const noexcept;
  void draw_near(const Overlay& overlay, const WatchedTick& now, const NearChoice& choice);
  /// The surface at a pixel, in the nearest point's plane: splats are flat, drawn further back, and larger
  /// where points are few. The splat itself until neighbours are known.
  [[nodiscard]] Hit on_surface(const Hit& hit, const Vec3& eye_mm);
  [[nodiscard]] SplatDrawer& splats() noexcept { return *splats_; }
  [[nodiscard]] const SplatDrawer& splats() const noexcept { return *splats_; }

 private:
  struct Model {
    std::vector<std::uint32_t> order;
    geometry::RigidTransform world_from_model;
    std::shared_ptr<const Surroundings> known;
    std::shared_ptr<const local_delaunay::LocalDelaunayMesh> stars;
    std::vector<std::uint32_t> star_place;  // indices in the cloud
    std::uint32_t nearest = 0;              // the last one found
    std::shared_ptr<const search::UniformGrid> grid;
    DentView dents;
    std::vector<std::uint32_t> index_of;  // in `order`; empty for rigid models
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
  bool streamed_ = false;           // images have replaced the points
  std::vector<Rgba> image_colour_;  // one for each point of an image
  std::shared_ptr<const ShownScene> scene_;
  geometry::Aabb box_mm_;
  std::vector<Model> models_;
  ColourBy colour_ = ColourBy::kPlain;
  ColourScale scale_;
  std::future<Coloured> colours_;
  std::future<std::vector<std::shared_ptr<const Surroundings>>> surroundings_;
  std::future<std::shared_ptr<const local_delaunay::LocalDelaunayMesh>> stars_;
  std::size_t stars_of_ = 0;
  std::future<std::shared_ptr<const search::UniformGrid>> grid_;
  std::size_t grid_of_ = 0;
  std::size_t asks_ = 0;  // counts questions, for turns between deformable models
};

}  // namespace palpate::experiments
