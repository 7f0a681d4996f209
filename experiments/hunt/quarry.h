// What the hunt turns: a small model, a renderer's options, and a way of the HIP or a hand, as a value that
// is drawn at random, changed a little, and written as text.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "toolkit/core/options.h"
#include "toolkit/core/random.h"
#include "toolkit/core/vec.h"

namespace palpate::experiments {

/// A point of the model, put elsewhere.
struct PointEdit {
  enum class Kind : std::uint8_t { kMove, kDouble, kDrop, kOnto } kind = Kind::kMove;
  double which = 0.0;      ///< share of the points, [0, 1)
  double other = 0.0;      ///< kOnto: the point that it is put on
  Vec3 by = Vec3::Zero();  ///< spacings
};

/// Where the HIP goes next.
struct Waypoint {
  enum class Kind : std::uint8_t { kFree, kAtPoint, kBetween } kind = Kind::kFree;
  Vec3 at = Vec3::Zero();           ///< kFree: halves of the box from its middle; else spacings off the place
  double which = 0.0, other = 0.0;  ///< points, shares as in PointEdit
  int frames = 1;                   ///< on the way there
};

/// A simulated hand that feels the formula, as the path generator of this name makes it.
struct HandWay {
  double force_n = 0.0;
  double fastest_mm_s = 0.0;  ///< the slowest stroke is a quarter of it, as of the usual hand
  double spacing_mm = 0.0;    ///< of the points that it strokes: decides the model's scale
  std::uint64_t seed = 1;

  /// The path generator with its options.
  [[nodiscard]] std::string path_text() const;
};

/// One thing to be tried. On a way the HIP starts above the model and returns there.
struct Quarry {
  std::string shape;  ///< a generator
  Options form;       ///< the generator's own options, as given
  int points = 0;
  std::string sampling;  ///< of the generator
  double noise = 0.0, outliers = 0.0;
  std::uint64_t model_seed = 1;
  double scale = 1.0;   ///< of all lengths
  double offset = 0.0;  ///< of the model from the origin, in its own sizes
  double friction = 0.0;
  std::vector<PointEdit> edits;
  std::vector<Waypoint> way;
  std::optional<HandWay> hand;  ///< in place of a way
  Options options;              ///< of the renderer, as given

  /// The points stand in their raster still, if they did: they were lifted at most.
  [[nodiscard]] bool keeps_raster() const;
  /// As a scene on the command line.
  [[nodiscard]] std::string model_text() const;
  /// The surface has a border.
  [[nodiscard]] bool open() const;
  /// Width of the thinnest part or crest of the shape, mm; infinite where it has none.
  [[nodiscard]] double finest_mm() const;
};

/// Parts and crests are judged where they are no finer than so many spacings: Caught allows a god object to
/// be two spacings off, so that on a thinner part it may be off on the other side.
inline constexpr double kFinestSpacings = 4.0;
/// Fewer points make no surface of any of the shapes: twenty spacings across a square.
inline constexpr double kFewestJudged = 300.0;
/// Of every model, N/mm, as usual.
inline constexpr double kHuntedStiffness = 0.5;

/// Frames that the ways of one quarry may have together; what is longer is cut.
inline constexpr int kMostFrames = 1500;
/// Frames of a hand: three seconds, in which it lifts once or twice.
inline constexpr int kHandFrames = 3000;

/// What a renderer leaves to be turned.
struct Ground {
  std::span<const OptionSpec> options;
  bool heights = false;  ///< it takes height fields alone: points of a raster, lifted and lowered
};
[[nodiscard]] Quarry random_quarry(Random& random, const Ground& ground);
/// One to three things changed.
[[nodiscard]] Quarry mutated(const Quarry& quarry, Random& random, const Ground& ground);

[[nodiscard]] std::string to_text(const Quarry& quarry);
/// False where the text is not one of to_text().
[[nodiscard]] bool from_text(const std::string& text, Quarry& quarry);

}  // namespace palpate::experiments
