// Draws a cloud point by point into a picture that is kept: a little more of it every frame, begun anew only
// when camera or model move. So the window stays quick however many points there are, and shows all of them
// as soon as one looks for a while.
//
// The points of a frame are a beginning of a random order: an even sample. Splats shrink as their number
// grows; early, large ones stand back by half their size, so that later, small ones win where both lie.
// How many points a frame draws follows from what the frames before took.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "experiments/window/camera.h"
#include "experiments/window/splat_points.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/rigid_transform.h"

namespace palpate::experiments {

/// What stands at a pixel of the kept picture.
struct Hit {
  Vec3 place_mm = Vec3::Zero();  ///< world
  Vec3 normal = Vec3::Zero();    ///< unit, world, towards the eye; zero where it is not known
};

/// One thread with a current OpenGL context (3.3 core), from construction to destruction.
class SplatDrawer {
 public:
  /// An Error where the graphics cannot do it: the driver's words.
  [[nodiscard]] static Result<std::unique_ptr<SplatDrawer>> create();
  ~SplatDrawer();
  SplatDrawer(const SplatDrawer&) = delete;
  SplatDrawer& operator=(const SplatDrawer&) = delete;

  /// Forgets all models.
  void clear();
  /// A further model: its number. Places as places_in_order() has them, relative to `origin_mm`.
  std::size_t add(std::span<const float> places, std::span<const Rgba> colours, const Vec3& origin_mm);
  void recolour(std::size_t model, std::span<const Rgba> colours);
  /// In the same order; empty ones are not known.
  void set_normals(std::size_t model, std::span<const PackedNormal> normals);
  /// The `index`-th point of a model in the order it was added in goes elsewhere, relative to its origin.
  void move(std::size_t model, std::size_t index, const Vec3f& place_mm);
  void place(std::size_t model, const geometry::RigidTransform& world_from_model);
  /// Whether normals shade; they do at first.
  void light(bool on);

  /// Goes on with the picture, or begins it anew where camera, size or a model changed. At most
  /// points_a_frame() points.
  void draw(const Camera& camera, int width_px, int height_px);
  /// Copies the kept picture into the default framebuffer.
  void show() const;
  /// What the last draw() took, to its end on the graphics processor: the next one draws as much as fits.
  void took(double draw_ms) noexcept;

  [[nodiscard]] std::size_t points() const noexcept { return points_; }
  [[nodiscard]] std::size_t drawn() const noexcept { return drawn_; }
  [[nodiscard]] std::size_t points_a_frame() const noexcept { return budget_; }
  /// How many pictures it took from the last beginning until every point was drawn; 0: that is to come.
  [[nodiscard]] std::size_t whole_after() const noexcept { return whole_after_; }
  /// How often the picture was begun anew.
  [[nodiscard]] std::uint64_t begun() const noexcept { return begun_; }

  /// The point nearest to the eye near a place of the picture, from the kept depth; nothing where no point
  /// is.
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
  unsigned squares_ = 0, discs_ = 0;  // programs
  Camera camera_;
  Mat4 clip_from_world_ = Mat4::Identity();
  int width_px_ = 0, height_px_ = 0;
  bool lit_ = true, stale_ = true;
  std::size_t points_ = 0, drawn_ = 0, budget_, last_drawn_ = 0;
  std::size_t pictures_ = 0, whole_after_ = 0;  // since it was begun
  double ms_a_point_ = 0.0;
  std::uint64_t begun_ = 0;
};

}  // namespace palpate::experiments
