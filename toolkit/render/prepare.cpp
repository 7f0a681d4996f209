#include "toolkit/render/prepare.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include <palpate/model_store.h>
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/winding_number.h"

namespace palpate::render {
namespace {
/// Extent divided by the rounding of a coordinate.
constexpr double kExtentPerRounding = 0x1p25;
}  // namespace

double coordinate_rounding_mm(const cloud::Cloud& cloud) {
  return cloud.box_mm().extent_mm().maxCoeff() * kUnitRoundoffFloat * 0.5;
}

bool float_precision_suffices(const cloud::Cloud& cloud, double spacing_mm) {
  return !(spacing_mm > 0.0) || coordinate_rounding_mm(cloud) <= kMaxRoundingShare * spacing_mm;
}

Decision coordinates_decision(const cloud::Cloud& cloud, double spacing_mm) {
  const double rounding_mm = coordinate_rounding_mm(cloud);
  const double share = spacing_mm > 0.0 ? rounding_mm / spacing_mm : 0.0;
  std::string reason =
      fmt::format("they round to {:.2g} mm, {:.2g} of the median spacing", rounding_mm, share);
  if (!float_precision_suffices(cloud, spacing_mm))
    reason += fmt::format(
        ": TOO COARSE, more than a hundredth; cut the cloud into models of a part of its extent, {:.0f} "
        "along "
        "its longest side",
        std::ceil(share / kMaxRoundingShare));
  else if (spacing_mm > 0.0)
    reason +=
        fmt::format(": its extent is 2^{:.0f} spacings, and floats hold up to 2^{:.0f}",
                    std::log2(share * kExtentPerRounding), std::log2(kMaxRoundingShare * kExtentPerRounding));
  return {"coordinates", "float, relative to the middle of the box", std::move(reason)};
}

std::optional<std::string> wide_mouth_warning(double min_enclosed) {
  const double mouth = 1.0 - min_enclosed;
  if (!(mouth > geometry::kWideOpeningFraction)) return std::nullopt;
  return fmt::format(
      "A piece encloses a volume but for a mouth of {:.0f} % of its surface: it is felt from the side on "
      "which a "
      "replay begins alone, and a probe that goes in by the mouth feels nothing. If the inner side is to be "
      "felt too, as of a vase, say sides=both.",
      100.0 * mouth);
}

geometry::Aabb box_of(const std::vector<ModelInput>& models) {
  geometry::Aabb box;
  constexpr int kCorners = 8;
  for (const ModelInput& model : models) {
    const geometry::Aabb own = model.cloud->box_mm();
    for (int corner = 0; corner < kCorners; ++corner) {
      Vec3 at = own.low_mm;
      for (int axis = 0; axis < 3; ++axis)
        if ((corner >> axis & 1) != 0) at[axis] = own.high_mm[axis];
      box.add(model.world_from_model * at);
    }
  }
  return box;
}

ModelInput subset_of(const ModelInput& model, std::span<const std::uint32_t> of,
                     const std::optional<cloud::ScanRaster>& raster) {
  ModelInput part = model;
  auto points = std::make_shared<cloud::Cloud>(cloud::subset_of(*model.cloud, of));
  points->raster = raster;
  part.cloud = std::move(points);
  part.original_mesh = nullptr;
  part.prepared = nullptr;
  if (const surface::PointProperties* p = model.surface.per_point.get())
    part.surface.per_point = std::make_shared<const surface::PointProperties>(surface::PointProperties{
        cloud::taken(p->stiffness_n_per_mm, of), cloud::taken(p->static_friction, of),
        cloud::taken(p->dynamic_friction, of), cloud::taken(p->deformation, of)});
  return part;
}

namespace {

/// Warnings for the user, whichever renderer prepared the data.
void add_to_report(const PrepareReport& of, PrepareReport& to) {
  to.bytes += of.bytes;
  to.notes.insert(to.notes.end(), of.notes.begin(), of.notes.end());
  to.warnings.insert(to.warnings.end(), of.warnings.begin(), of.warnings.end());
}

}  // namespace

std::shared_ptr<const void> ModelStore::find(const std::string& key, PrepareReport& report) {
  std::erase_if(held_, [](const auto& entry) { return entry.second.geometry.expired(); });
  const auto found = held_.find(key);
  std::shared_ptr<const void> geometry = found == held_.end() ? nullptr : found->second.geometry.lock();
  if (geometry == nullptr) return nullptr;
  add_to_report(found->second.report, report);
  report.shared_bytes += found->second.report.bytes;
  return geometry;
}

void ModelStore::keep(const std::string& key, const std::shared_ptr<const void>& geometry, PrepareReport own,
                      PrepareReport& report) {
  add_to_report(own, report);
  report.total_ms += own.total_ms;
  report.phases.insert(report.phases.end(), own.phases.begin(), own.phases.end());
  held_[key] = {geometry, std::move(own)};
}

std::size_t ModelStore::size() const {
  const std::scoped_lock lock(mutex_);
  return static_cast<std::size_t>(std::count_if(
      held_.begin(), held_.end(), [](const auto& entry) { return !entry.second.geometry.expired(); }));
}

std::string key_text(const Options& options, std::span<const OptionSpec> specs) {
  std::string text;
  for (const OptionSpec& spec : specs) text += fmt::format(" {}={}", spec.key, options.text(spec.key));
  return text;
}

}  // namespace palpate::render
