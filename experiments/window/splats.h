// Draws a cloud progressively into a kept picture. Each frame adds points; the picture restarts only when
// camera or model moves, so the window stays quick for any number of points.
//
// A frame's points are a prefix of a random order: an even sample. Splats shrink as their number grows;
// early, large ones lie back by half their size, so later, small ones win. The number of points a frame
// follows from earlier frames' times.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/result.h>
#include "experiments/window/camera.h"
#include "experiments/window/splat_points.h"

namespace palpate::experiments {

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

  /// Continues the picture, or restarts it after a change of camera, size or model. Draws no
  /// more points than took() found time for.
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

}  // namespace palpate::experiments
