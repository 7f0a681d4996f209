#include "experiments/run/run.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <palpate/accuracy.h>
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/statistics.h"
#include "toolkit/metrics/closest_point.h"

namespace palpate::experiments {
namespace {

// Models that are so many times their size apart are not felt together by one hand.
constexpr double kFarApart = 10.0;
// Metres taken for millimetres are a factor of 1000, inches 25, centimetres 10. Parts of one scene differ by
// less than this:
constexpr double kOtherScale = 100.0;
// A reference shows the model itself: it may be a good part larger or smaller, not a unit.
constexpr double kOtherReference = 8.0;
// Points of a scan lie within its spacing of the surface it was made from; so many times it is another place.
constexpr double kOffReference = 3.0;
constexpr std::size_t kAsked = 255;  // points, evenly over the cloud
// Boxes of a flat model and of its noisy scan may miss each other by this part of the model's size.
constexpr double kBoxSlack = 0.01;

geometry::Aabb world_box(const render::ModelInput& model) {
  const geometry::Aabb own = model.cloud->box_mm();
  geometry::Aabb box;
  for (int corner = 0; corner < 8; ++corner)
    box.add(model.world_from_model * Vec3((corner & 1) != 0 ? own.high_mm.x() : own.low_mm.x(),
                                          (corner & 2) != 0 ? own.high_mm.y() : own.low_mm.y(),
                                          (corner & 4) != 0 ? own.high_mm.z() : own.low_mm.z()));
  return box;
}

double diagonal_mm(const geometry::Aabb& box) {
  return box.extent_mm().norm();
}

double gap_mm(const geometry::Aabb& a, const geometry::Aabb& b) {
  return (a.low_mm - b.high_mm).cwiseMax(b.low_mm - a.high_mm).cwiseMax(0.0).norm();
}

std::string box_text(const geometry::Aabb& box) {
  const Vec3 &low = box.low_mm, &high = box.high_mm;
  return fmt::format("({:.4g}, {:.4g}, {:.4g}) to ({:.4g}, {:.4g}, {:.4g}) mm", low.x(), low.y(), low.z(),
                     high.x(), high.y(), high.z());
}

/// "a metre is 1000 mm" and the like, where the ratio of two sizes is that of two units.
std::string unit_hint(double ratio) {
  const double factor = std::max(ratio, 1.0 / ratio);
  const auto about = [&](double unit) { return factor > 0.5 * unit && factor < 2.0 * unit; };
  if (about(1000.0)) return " About 1000 times: metres and millimetres?";
  if (about(25.4)) return " About 25 times: inches and millimetres?";
  return about(10.0) ? " About 10 times: centimetres and millimetres?" : "";
}

std::string why_apart(const geometry::Aabb& path, const geometry::Aabb& models) {
  const double ratio = diagonal_mm(path) / diagonal_mm(models);
  if (diagonal_mm(path) > 0.0 && (ratio > kOtherScale || ratio < 1.0 / kOtherScale))
    return fmt::format(
        "The path spans {} mm and the model {} mm: is one of them in another unit (--unit, --scale, or "
        "mm_per_unit of a recording)?{}",
        format_number(diagonal_mm(path)), format_number(diagonal_mm(models)), unit_hint(ratio));
  if (!path.overlaps(models))
    return fmt::format(
        "The path stays within {}, the model within {}: is one of them in another frame or unit?",
        box_text(path), box_text(models));
  return "Is the path deep enough, and in the model's frame and unit?";
}

std::string never_touches(const StagedStudy& study) {
  const std::vector<render::ModelInput>& models = study.stage.scene.input.models;
  const trace::ProbePath& path = study.stage.path;
  const metrics::ClosestApproach approach = metrics::closest_approach(path, models);
  geometry::Aabb path_box, model_box;
  for (const Vec3& p : path.hip_mm) path_box.add(p);
  for (const render::ModelInput& model : models) model_box.add(world_box(model));
  const bool moving = study.stage.scene.input.simulation != nullptr;
  return fmt::format(
      "The path never touches: its nearest approach is {} mm from a point of '{}'{}, at {:.4g} s. {}",
      format_number(approach.distance_mm), models[approach.model].name,
      moving ? " (where it stands at the start)" : "", path.t_s[approach.sample],
      why_apart(path_box, model_box));
}

std::size_t contact_frames(const trace::ForceTrace& trace) {
  return static_cast<std::size_t>(std::count_if(trace.frames.begin(), trace.frames.end(),
                                                [](const render::Frame& f) { return f.contact; }));
}

}  // namespace

Status check_surfaces(const scene::LoadedScene& scene) {
  for (std::size_t i = 0; i < scene.input.models.size(); ++i) {
    const render::ModelInput& model = scene.input.models[i];
    if (const std::optional<std::string> why = cloud::degeneracy_of(*model.cloud))
      return Error{fmt::format("'{}' is no surface to be felt: {}", model.name, *why),
                   "is it the right file, and are its columns x, y, z? `palpate info` shows what it holds",
                   scene.provenance[i].source};
  }
  return Done{};
}

std::vector<std::string> warnings_about_tiles(const render::FrameCounters& counted) {
  std::vector<std::string> warnings;
  if (counted.damaged_tiles > 0)
    warnings.push_back(
        fmt::format("{} tile{} of the prepared file {} damaged, the first number {}: felt as absent. Prepare "
                    "the scan again.",
                    counted.damaged_tiles, counted.damaged_tiles == 1 ? "" : "s",
                    counted.damaged_tiles == 1 ? "is" : "are", counted.damaged_tile));
  if (counted.coarse_frames > 0)
    warnings.push_back(
        fmt::format("{} frames looked for a part of the prepared surface that was not in memory; a coarser "
                    "one answered {} frames. Give more by resident_mb.",
                    counted.late_frames, counted.coarse_frames));
  return warnings;
}

std::vector<std::string> warnings_about_models(const scene::LoadedScene& scene) {
  std::vector<std::string> warnings;
  const std::vector<render::ModelInput>& models = scene.input.models;
  if (models.size() < 2) return warnings;
  std::vector<geometry::Aabb> boxes;
  for (const render::ModelInput& model : models) boxes.push_back(world_box(model));
  const auto by_size = [](const geometry::Aabb& a, const geometry::Aabb& b) {
    return diagonal_mm(a) < diagonal_mm(b);
  };
  const auto largest = std::max_element(boxes.begin(), boxes.end(), by_size);
  const double size = diagonal_mm(*largest);
  for (std::size_t i = 0; i < models.size(); ++i) {
    double nearest = HUGE_VAL;
    for (std::size_t j = 0; j < models.size(); ++j)
      if (j != i) nearest = std::min(nearest, gap_mm(boxes[i], boxes[j]));
    if (nearest > kFarApart * size)
      warnings.push_back(fmt::format(
          "'{}' stands {} mm from the nearest other model, {} times the size of the largest: check "
          "position_mm, unit and scale.",
          models[i].name, format_number(nearest), format_number(nearest / size)));
    const double own = diagonal_mm(boxes[i]);
    if (own * kOtherScale < size)
      warnings.push_back(fmt::format("'{}' is {} mm across, '{}' {} mm: is one of them in another unit?{}",
                                     models[i].name, format_number(own),
                                     models[static_cast<std::size_t>(largest - boxes.begin())].name,
                                     format_number(size), unit_hint(size / own)));
  }
  return warnings;
}

Result<std::vector<std::string>> warnings_about_reference(const geometry::TriangleMesh& truth,
                                                          const render::ModelInput& model,
                                                          const std::string& file) {
  const geometry::Aabb own = model.cloud->box_mm();
  geometry::Aabb box;
  for (const auto& triangle : truth.triangles)
    for (const std::uint32_t vertex : triangle) box.add(truth.vertices_mm[vertex]);
  const double ratio = diagonal_mm(box) / diagonal_mm(own);
  const std::string boxes =
      fmt::format("it fills {}, the model '{}' {}", box_text(box), model.name, box_text(own));
  if (!box.overlaps(own.grown(kBoxSlack * diagonal_mm(own))))
    return Error{"the reference stands elsewhere than the model: " + boxes,
                 "the reference must be in the model's frame, unit and scale, before the scene's pose", file};
  std::vector<std::string> warnings;
  if (ratio > kOtherReference || ratio < 1.0 / kOtherReference)
    warnings.push_back(fmt::format("The reference is {} times as large as the model: {}.{}",
                                   format_number(ratio), boxes, unit_hint(ratio)));
  return warnings;
}

std::vector<std::string> warnings_about_alignment(const Stage& stage) {
  if (stage.truth == nullptr) return {};
  const render::ModelInput& model = stage.scene.input.models.front();
  const cloud::Cloud& cloud = *model.cloud;
  std::vector<double> off_mm;
  for (std::size_t k = 0; k < kAsked; ++k) {
    const Vec3 p = model.world_from_model * cloud.point_mm(k * (cloud.size() - 1) / (kAsked - 1));
    off_mm.push_back((stage.truth->closest(p).point_mm - p).norm());
  }
  const double median = upper_median(std::move(off_mm)), spacing = stage.spacing.eighth_mm.p50;
  if (!(median > kOffReference * spacing)) return {};
  return {
      fmt::format("The model's points lie {} mm (median) off the reference, {} times the distance to their "
                  "eighth neighbour: is it in the model's frame, unit and scale?",
                  format_number(median), format_number(median / spacing))};
}

namespace {

/// Share of the contact that depends on the way taken.
std::vector<std::string> remarks_on_history(const StagedStudy& study) {
  if (!study.stage.reference || !study.stage.reference->compared) return {};
  std::size_t undecided = 0, contact = 0;
  for (const trace::TruthFrame& frame : study.stage.reference->frames) {
    undecided += frame.history_decides ? 1u : 0u;
    contact += frame.history_decides || frame.frame.contact ? 1u : 0u;
  }
  if (undecided == 0) return {};
  return {fmt::format(
      "In {} frames, {} % of the contact, history decides: the closest point of the whole surface is another "
      "answer than the one that the way leads to. They are scored apart; all other scores are of the rest.",
      format_count(undecided),
      format_number(100.0 * static_cast<double>(undecided) / static_cast<double>(contact)))};
}

}  // namespace

std::vector<std::string> remarks_on_reference(const StagedStudy& study) {
  std::vector<std::string> remarks = remarks_on_history(study);
  const Stage& stage = study.stage;
  if (!stage.reference ||
      (stage.reference->name != "original-mesh" &&
       (stage.reference->name != "closest-point" || stage.scene.input.models.front().analytic != nullptr)))
    return remarks;
  std::vector<std::string> same;
  for (const Run& run : study.runs)
    if (run.own_faces) same.push_back(run.result.label);
  if (same.empty()) return remarks;
  remarks.push_back(
      fmt::format("The ground truth is the file's own faces, and {} feels the same ones: an error of 0 says "
                  "that it follows them, not that they are the thing that was scanned.",
                  joined(same, " as well as ")));
  return remarks;
}

std::vector<std::string> warnings_about_contact(const StagedStudy& study) {
  std::vector<std::string> warnings;
  if (study.stage.path.size() == 0) return warnings;
  std::size_t truth = 0, most = 0;
  if (study.stage.reference)
    for (const trace::TruthFrame& frame : study.stage.reference->frames) truth += frame.frame.contact;
  std::vector<const Run*> felt_nothing;
  bool any_ran = false;
  for (const Run& run : study.runs) {
    if (run.trace.frames.empty()) continue;
    any_ran = true;
    const std::size_t frames = contact_frames(run.trace);
    most = std::max(most, frames);
    if (frames == 0) felt_nothing.push_back(&run);
  }
  if (!any_ran) return warnings;
  if (study.stage.reference ? truth == 0 : most == 0) {
    warnings.push_back(never_touches(study));
    return warnings;
  }
  for (const Run* run : felt_nothing)
    warnings.push_back(
        study.stage.reference
            ? fmt::format("{} never feels the model; the truth does in {} frames.", run->result.label, truth)
            : fmt::format("{} never feels the model; another renderer does in up to {} frames.",
                          run->result.label, most));
  return warnings;
}

namespace {

constexpr std::size_t kShownStretches = 3;

/// Renderers apart from the others in a frame.
enum Apart : int { kAgree = -2, kNobodyAlone = -1 };  // else the number of the run that stands alone

struct Stretch {
  std::size_t begin = 0, end = 0;
  int alone = kNobodyAlone;
};

class Compared {
 public:
  explicit Compared(const StagedStudy& study) : study_(study) {
    for (const Run& run : study.runs)
      if (run.trace.frames.size() == study.stage.path.size()) runs_.push_back(&run);
    most_mm_ = std::max(metrics::kCaughtMm, metrics::kCaughtSpacings * study.stage.spacing.nearest_mm.p50);
  }

  [[nodiscard]] std::vector<std::string> sentences() const {
    if (runs_.size() < 2) return {};
    std::vector<Stretch> found = stretches();
    if (found.empty()) return {};
    std::stable_sort(found.begin(), found.end(),
                     [](const Stretch& a, const Stretch& b) { return a.end - a.begin > b.end - b.begin; });
    double seconds = 0.0;
    for (const Stretch& stretch : found) seconds += length_s(stretch);
    std::vector<std::string> out{fmt::format(
        "The renderers disagree by more than {} mm in {} stretch{}, {} s of {} s: there is no truth that "
        "says who is right.",
        format_number(most_mm_), found.size(), found.size() == 1 ? "" : "es", format_number(seconds),
        format_number(study_.stage.path.t_s.back() - study_.stage.path.t_s.front()))};
    for (std::size_t i = 0; i < std::min(found.size(), kShownStretches); ++i)
      out.push_back(sentence(found[i]));
    return out;
  }

 private:
  [[nodiscard]] bool near(std::size_t a, std::size_t b, std::size_t i) const {
    const Vec3 d = runs_[a]->trace.frames[i].god_object_mm - runs_[b]->trace.frames[i].god_object_mm;
    return d.norm() <= most_mm_;
  }
  [[nodiscard]] int apart(std::size_t i) const {
    int lone = kAgree;
    for (std::size_t a = 0; a < runs_.size(); ++a) {
      std::size_t others = 0;
      for (std::size_t b = 0; b < runs_.size(); ++b) others += b != a && !near(a, b, i);
      if (others == 0) continue;
      const bool alone = others == runs_.size() - 1 && runs_.size() > 2;
      if (!alone) {
        lone = lone == kAgree ? kNobodyAlone : lone;
      } else if (lone >= 0) {
        return kNobodyAlone;  // two of them
      } else {
        lone = static_cast<int>(a);
      }
    }
    return lone;
  }
  [[nodiscard]] double length_s(const Stretch& s) const {
    return study_.stage.path.t_s[s.end - 1] - study_.stage.path.t_s[s.begin];
  }
  [[nodiscard]] std::vector<Stretch> stretches() const {
    std::vector<Stretch> out;
    Stretch now{0, 0, kAgree};
    const auto close = [&](std::size_t end) {
      now.end = end;
      if (now.alone != kAgree && now.end > now.begin && length_s(now) >= metrics::kMinArtefactS)
        out.push_back(now);
    };
    for (std::size_t i = 0; i < study_.stage.path.size(); ++i) {
      const int who = apart(i);
      if (who == now.alone) continue;
      close(i);
      now = {i, i, who};
    }
    close(study_.stage.path.size());
    return out;
  }
  [[nodiscard]] std::string sentence(const Stretch& s) const {
    const trace::ProbePath& path = study_.stage.path;
    const Vec3& at = path.hip_mm[s.begin];
    const std::string where =
        fmt::format("for {} s from {} s on, the HIP at {}, {}, {} mm", format_number(length_s(s)),
                    format_number(path.t_s[s.begin]), format_number(at.x()), format_number(at.y()),
                    format_number(at.z()));
    if (s.alone == kNobodyAlone) {
      std::vector<std::string> labels;
      for (const Run* run : runs_)
        labels.push_back(run->result.label + (run->trace.frames[s.begin].contact ? "" : " (feels nothing)"));
      return fmt::format("There is no majority {}: {}.", where, joined(labels));
    }
    const Run& lone = *runs_[static_cast<std::size_t>(s.alone)];
    const render::Frame& frame = lone.trace.frames[s.begin];
    return fmt::format("{} stands alone {}: {}.", lone.result.label, where,
                       frame.contact
                           ? fmt::format("{} N where it begins", format_number(frame.force_n.norm()))
                           : std::string("it feels nothing, the others do"));
  }

  const StagedStudy& study_;
  std::vector<const Run*> runs_;
  double most_mm_ = 0.0;
};

}  // namespace

std::vector<std::string> disagreements(const StagedStudy& study) {
  if (study.stage.reference || study.stage.path.size() < 2) return {};
  return Compared(study).sentences();
}

}  // namespace palpate::experiments
