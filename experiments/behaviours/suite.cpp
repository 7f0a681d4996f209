// The fixed suite. Lengths in mm; each scene's numbers suit its spacing and are in the report's text.
#include <cmath>
#include <numbers>

#include <palpate/paths.h>
#include "experiments/behaviours/behaviour.h"
#include "toolkit/core/random.h"

namespace palpate::experiments {
namespace {

constexpr std::size_t kPushes = 20;  // of each kind
constexpr std::size_t kLines = 5;    // slides of each kind

double travelled(const Stroke& stroke, std::size_t sample) {
  return 1e3 * stroke.path.t_s[sample];
}
double force_z(const render::Frame& frame) {
  return frame.force_n.z();
}

/// Collects scenes and strokes; keeps the first Error.
class Maker {
 public:
  explicit Maker(std::string id, std::string title) {
    made_.id = std::move(id);
    made_.title = std::move(title);
    made_.x_label = "time, ms";
    made_.y_label = "force along z, N";
    made_.x = travelled;
    made_.y = force_z;
  }
  Behaviour* operator->() noexcept { return &made_; }
  std::size_t scene(Result<BehaviourScene> scene) {
    if (!scene) {
      fault_ = scene.error();
      return 0;
    }
    made_.scenes.push_back(*std::move(scene));
    return made_.scenes.size() - 1;
  }
  [[nodiscard]] bool failed() const noexcept { return fault_.has_value(); }
  void stroke(std::size_t scene, const std::vector<Vec3>& corners, double speed_mm_s = kHandSpeed) {
    if (!failed()) add(experiments::stroke(made_.scenes, scene, corners, speed_mm_s));
  }
  void along(std::size_t scene, Result<trace::ProbePath> path) {
    if (failed()) return;
    if (!path)
      fault_ = path.error();
    else
      add(stroke_along(made_.scenes, scene, *std::move(path)));
  }
  Result<Behaviour> done() {
    if (fault_) return *fault_;
    return std::move(made_);
  }

 private:
  void add(Result<Stroke> stroke) {
    if (stroke)
      made_.strokes.push_back(*std::move(stroke));
    else
      fault_ = stroke.error();
  }
  Behaviour made_;
  std::optional<Error> fault_;
};

std::uint64_t one(const Stroke&) {
  return 1;
}

/// Counts true contact frames with `wrong(frame, truth)`.
template <class Wrong>
Judge frames_where(Wrong wrong) {
  return [wrong](const Stroke& s, std::span<const render::Frame> frames) {
    std::uint64_t n = 0;
    for (std::size_t i = 0; i < frames.size(); ++i)
      n += s.truth.frames[i].frame.contact && wrong(frames[i], s.truth.frames[i]);
    return n;
  };
}

/// Counts forces while the HIP is truly outside.
std::uint64_t felt_outside(const Stroke& s, std::span<const render::Frame> frames) {
  std::uint64_t n = 0;
  for (std::size_t i = 0; i < frames.size(); ++i)
    n += !s.truth.frames[i].frame.contact && frames[i].force_n != Vec3::Zero();
  return n;
}
std::uint64_t outside_frames(const Stroke& s) {
  return s.truth.frames.size() - contact_frames(s);
}

Result<Behaviour> thin_plate() {
  constexpr double kDeepMm = 0.3;  // 1.5 spacings: the side is beyond doubt
  Maker make("thin-plate", "thin plate");
  make->text =
      "A plate 1 mm thick of points 0.2 mm apart, pushed 20 times from above and 20 times from below, "
      "straight through to 1 mm behind it. Whoever takes the nearest point is thrown out at the back.";
  make->counted = "pushes thrown out at the back";
  const std::size_t plate = make.scene(generated_scene("slab:extent_mm=20:thickness_mm=1:spacing_mm=0.2"));
  for (const double side : {1.0, -1.0})
    for (std::size_t i = 0; i < kPushes; ++i) {
      const double x = scattered(i, -7, 7), y = scattered(3 * i + 1, -7, 7);
      make.stroke(plate, {{x, y, 1.5 * side}, {x + 0.3, y + 0.2, -1.5 * side}, {x, y, 1.5 * side}});
    }
  make->judge = [](const Stroke& s, std::span<const render::Frame> frames) {
    for (std::size_t i = 0; i < frames.size(); ++i)
      if (s.truth.frames[i].frame.contact && s.truth.frames[i].signed_distance_mm < -kDeepMm &&
          !(frames[i].force_n.dot(s.entry) > 0.0))
        return std::uint64_t{1};
    return std::uint64_t{0};
  };
  make->whole = one;
  return make.done();
}

Result<Behaviour> voronoi_corner() {
  constexpr double kTurnedDeg = 45.0;  // half a right angle: another face's force
  Maker make("voronoi-corner", "corner of a block");
  make->text =
      "Figure 25a: the probe enters a block by its side, 1 mm below the top edge, and goes 3 mm deep. From 1 "
      "mm on the top is nearer than the side. Points 0.25 mm apart, 20 pushes.";
  make->counted = "pushes whose force turns to the top";
  const std::size_t block = make.scene(generated_scene("slab:extent_mm=20:thickness_mm=10:spacing_mm=0.25"));
  for (std::size_t i = 0; i < kPushes; ++i) {
    const double y = scattered(i, -7, 7);
    make.stroke(block, {{12, y, 4.0}, {7, y + 0.3, 4.0}, {12, y, 4.0}});
  }
  make->judge = [](const Stroke& s, std::span<const render::Frame> frames) {
    constexpr double kDeepMm = 0.5;  // two spacings
    for (std::size_t i = 0; i < frames.size(); ++i)
      if (s.truth.frames[i].frame.contact && s.truth.frames[i].signed_distance_mm < -kDeepMm &&
          turned_by(frames[i], s.truth.frames[i], kTurnedDeg))
        return std::uint64_t{1};
    return std::uint64_t{0};
  };
  make->whole = one;
  make->y_label = "force along x, N";
  make->y = [](const render::Frame& frame) { return frame.force_n.x(); };
  return make.done();
}

Result<Behaviour> concave_wedge() {
  Maker make("concave-wedge", "bottom of a groove");
  make->text =
      "A groove of two planes, 120 degrees open, points 0.2 mm apart: down one flank 1 mm deep, through the "
      "bottom, where both flanks hold the god object, and up the other. Five slides.";
  make->counted = "frames in contact with a force off by more than 7 %";
  const std::size_t groove = make.scene(generated_scene("wedge:angle_deg=240:extent_mm=30:spacing_mm=0.2"));
  const double rise = 1.0 / std::tan(std::numbers::pi / 3.0);
  for (std::size_t i = 0; i < kLines; ++i) {
    const double y = scattered(i, -8, 8);
    make.stroke(groove, {{-8, y, 8 * rise + 1},
                         {-6, y + 0.4, 6 * rise - 1.15},
                         {0, y + 0.9, -1.15},
                         {6, y + 1.3, 6 * rise - 1.15},
                         {8, y + 1.7, 8 * rise + 1}});
  }
  make->judge = frames_where(out_of_band);
  make->whole = contact_frames;
  return make.done();
}

Result<Behaviour> hovering() {
  Maker make("hovering", "hovering over the points");
  make->text =
      "Figure 44: the probe hovers 0.35 mm over a plane of points 1 mm apart, within the half-length of "
      "their boxes, and never touches it. Five lines.";
  make->counted = "frames with a force while outside";
  const std::size_t plane = make.scene(generated_scene("plane:extent_mm=30:spacing_mm=1"));
  for (std::size_t i = 0; i < kLines; ++i) {
    const double y = scattered(i, -8, 8);
    make.stroke(plane, {{-10, y, 3}, {-9.6, y, 0.35}, {10, y + 0.7, 0.35}, {10.4, y + 0.7, 3}});
  }
  make->judge = felt_outside;
  make->whole = outside_frames;
  return make.done();
}

Result<Behaviour> narrow_groove() {
  Maker make("narrow-groove", "leaving a narrow groove");
  make->text =
      "Figure 45: a coarse narrow groove, 60 degrees open, points 1 mm apart. The probe presses 0.4 mm into "
      "one flank, comes back to the middle and leaves straight up, past the boxes of both flanks. Five "
      "times.";
  make->counted = "frames with a force while outside";
  const std::size_t groove = make.scene(generated_scene("wedge:angle_deg=300:extent_mm=30:spacing_mm=1"));
  for (std::size_t i = 0; i < kLines; ++i) {
    const double y = scattered(i, -8, 8);
    make.stroke(groove,
                {{0.5, y, 14}, {0.5, y, 6}, {3.9, y + 0.3, 6}, {0.4, y + 0.3, 6}, {0.4, y + 0.3, 14}});
  }
  make->judge = felt_outside;
  make->whole = outside_frames;
  return make.done();
}

Result<Behaviour> aliasing() {
  Maker make("aliasing", "crossed between two frames");
  make->text =
      "Figure 19: a plate 0.3 mm thick of points 0.1 mm apart, crossed 25 times at each of 0.15, 0.5, 1.5 "
      "and 5 m/s. From 0.3 m/s on no frame need find the probe inside.";
  make->counted = "crossings that nothing is felt of";
  const std::size_t plate = make.scene(generated_scene("slab:extent_mm=16:thickness_mm=0.3:spacing_mm=0.1"));
  constexpr std::size_t kCrossings = 25;
  for (const double speed : {150.0, 500.0, 1500.0, 5000.0})
    for (std::size_t i = 0; i < kCrossings; ++i) {
      const double x = scattered(i, -5, 5), y = scattered(5 * i + 2, -5, 5), start = scattered(7 * i, 6, 11);
      make.stroke(plate, {{x, y, start}, {x + 0.4, y + 0.3, -6}}, speed);
    }
  make->judge = [](const Stroke& s, std::span<const render::Frame> frames) {
    bool felt = false;
    for (std::size_t i = 0; i < frames.size(); ++i)
      felt |= s.truth.frames[i].frame.contact && frames[i].contact;
    return std::uint64_t{!felt};
  };
  make->whole = one;
  make->shown = 3 * kCrossings;
  return make.done();
}

Result<Behaviour> holes() {
  Maker make("holes", "coarse, with holes");
  constexpr double kHoleMm = 1.6, kApartMm = 6.0;
  make->text =
      "A plane of points 1 mm apart in which every 6 mm all points within 1.6 mm are missing, as where a "
      "scanner did not see. The probe slides over it 0.5 mm deep, five lines.";
  make->counted = "frames in contact without a force";
  PALPATE_ASSIGN(BehaviourScene whole, generated_scene("plane:extent_mm=40:spacing_mm=1"));
  std::vector<Vec3> left;
  const cloud::Cloud& cloud = *whole.input.models.front().cloud;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 p = cloud.point_mm(i);
    const double dx = p.x() - kApartMm * std::round(p.x() / kApartMm),
                 dy = p.y() - kApartMm * std::round(p.y() / kApartMm);
    if (std::hypot(dx, dy) > kHoleMm) left.push_back(p);
  }
  const std::size_t plane = make.scene(scene_of_points(left, "a plane with holes", whole.surface));
  for (std::size_t i = 0; i < kLines; ++i) {
    const double y = scattered(i, -3, 3);
    make.stroke(plane, {{-14.5, y, 1}, {-14, y, -0.5}, {14, y + 1.1, -0.5}, {14.5, y + 1.1, 1}});
  }
  make->judge = frames_where([](const render::Frame& frame, const trace::TruthFrame& truth) {
    constexpr double kDeepMm = 0.3;  // away from entry and exit
    return truth.signed_distance_mm < -kDeepMm && frame.force_n == Vec3::Zero();
  });
  make->whole = contact_frames;
  return make.done();
}

Result<Behaviour> two_sheets() {
  Maker make("two-sheets", "two close sheets");
  make->text =
      "Two sheets 0.4 mm apart of points 0.3 mm apart. The probe slides over the upper one 1.2 mm deep, "
      "three times their distance. Five lines.";
  make->counted = "frames in contact with a force off by more than 7 %";
  const std::size_t plate = make.scene(generated_scene("slab:extent_mm=24:thickness_mm=0.4:spacing_mm=0.3"));
  for (std::size_t i = 0; i < kLines; ++i) {
    const double y = scattered(i, -7, 7);
    make.stroke(plate, {{-8, y, 1}, {-7.5, y, -1.0}, {7.5, y + 0.8, -1.0}, {8, y + 0.8, 1}});
  }
  make->judge = frames_where(out_of_band);
  make->whole = contact_frames;
  return make.done();
}

Result<Behaviour> noisy() {
  Maker make("noise", "noisy scan");
  constexpr double kNoiseMm = 0.02;
  make->text =
      "A wavy surface of points 0.2 mm apart, each moved along the normal by noise of 0.02 mm (one sigma, "
      "seeded). The truth is the surface without noise; the probe goes in and out to 1 mm.";
  make->counted = "frames in contact with a force off by more than 7 %";
  PALPATE_ASSIGN(BehaviourScene clean,
                 generated_scene("sinusoid:extent_mm=40:amplitude_mm=2:wavelength_mm=20:spacing_mm=0.2"));
  const cloud::Cloud& cloud = *clean.input.models.front().cloud;
  std::vector<Vec3> points;
  Random random(1);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 p = cloud.point_mm(i);
    points.emplace_back(p + kNoiseMm * random.normal() * clean.surface->closest(p).normal);
  }
  const std::size_t scan = make.scene(scene_of_points(points, "a noisy scan", clean.surface));
  if (make.failed()) return make.done();
  paths::PathTarget target;
  target.surface = make->scenes[scan].surface.get();
  target.box_mm = target.surface->box_mm();
  make.along(scan, paths::make_path(*parse_named_options("weave:frames=5000:depth_mm=1"), target));
  make->judge = frames_where(out_of_band);
  make->whole = contact_frames;
  return make.done();
}

Result<Behaviour> ridge() {
  Maker make("ridge", "edge of a ridge");
  constexpr double kTurnedDeg = 10.0;  // well below the 25.6 degrees that a hand distinguishes at rest
  make->text =
      "A ridge of 120 degrees, points 0.2 mm apart, crossed 0.5 mm deep in five slides: shading that smooths "
      "too much takes the edge away.";
  make->counted = "frames within 2 mm of the edge whose force is turned by more than 10 degrees";
  const std::size_t wedge = make.scene(generated_scene("wedge:angle_deg=120:extent_mm=30:spacing_mm=0.2"));
  const double fall = 1.0 / std::tan(std::numbers::pi / 3.0);
  const double deep = 0.5 / std::sin(std::numbers::pi / 3.0);  // along z, for 0.5 mm along the normal
  for (std::size_t i = 0; i < kLines; ++i) {
    const double y = scattered(i, -8, 8);
    make.stroke(wedge, {{-7, y, -7 * fall + 1},
                        {-5, y + 0.4, -5 * fall - deep},
                        {0, y + 0.9, -deep},
                        {5, y + 1.3, -5 * fall - deep},
                        {7, y + 1.7, -7 * fall + 1}});
  }
  const auto near_edge = [](const Stroke& s, std::size_t i) {
    constexpr double kNearMm = 2.0;
    return s.truth.frames[i].frame.contact && std::abs(s.path.hip_mm[i].x()) < kNearMm;
  };
  make->judge = [near_edge](const Stroke& s, std::span<const render::Frame> frames) {
    std::uint64_t n = 0;
    for (std::size_t i = 0; i < frames.size(); ++i)
      n += near_edge(s, i) && turned_by(frames[i], s.truth.frames[i], kTurnedDeg);
    return n;
  };
  make->whole = [near_edge](const Stroke& s) {
    std::uint64_t n = 0;
    for (std::size_t i = 0; i < s.truth.frames.size(); ++i) n += near_edge(s, i);
    return n;
  };
  make->y_label = "force along x, N";
  make->y = [](const render::Frame& frame) { return frame.force_n.x(); };
  return make.done();
}

}  // namespace

Result<std::vector<Behaviour>> behaviour_suite(Progress& progress) {
  std::vector<Behaviour> suite;
  for (const auto& make : {thin_plate, voronoi_corner, concave_wedge, hovering, narrow_groove, aliasing,
                           holes, two_sheets, noisy, ridge}) {
    progress.report("making the scenes", static_cast<double>(suite.size()) / 10.0);
    PALPATE_ASSIGN(Behaviour made, make());
    suite.push_back(std::move(made));
  }
  return suite;
}

}  // namespace palpate::experiments
