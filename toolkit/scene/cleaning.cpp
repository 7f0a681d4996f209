#include <palpate/scene.h>

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <numeric>

#include <palpate/clock.h>
#include <palpate/result.h>
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/messages.h"
#include "toolkit/search/knn.h"
#include "toolkit/search/point_search.h"

namespace palpate::scene {
namespace {

std::string choices_of(const std::vector<CleaningStep>& steps) {
  return "choose from " + (steps.empty() ? "none in this program" : joined(names_of(steps)));
}

/// Points without a source take the nearest input point's.
void find_sources(const cloud::Cloud& cloud, CleaningStepOutput& output) {
  const std::size_t first = output.from.size() - output.new_points_mm.size();
  if (std::find(output.from.begin() + static_cast<std::ptrdiff_t>(first), output.from.end(),
                kNearestInputPoint) == output.from.end())
    return;
  const search::PointSearch points(cloud);
  for (std::size_t i = first; i < output.from.size(); ++i)
    if (output.from[i] == kNearestInputPoint)
      output.from[i] =
          static_cast<std::uint32_t>(points.nearest(cloud.origin_mm + output.new_points_mm[i - first]));
}

bool is_in_order(const std::vector<std::uint32_t>& from, std::size_t input) {
  if (from.size() != input) return false;
  for (std::size_t i = 0; i < from.size(); ++i)
    if (from[i] != i) return false;
  return true;
}

Result<cloud::Cloud> apply(const cloud::Cloud& input, const CleaningStepOutput& output) {
  std::vector<Vec3> points;
  points.reserve(output.from.size());
  const std::size_t first = output.from.size() - output.new_points_mm.size();
  for (std::size_t i = 0; i < output.from.size(); ++i)
    points.push_back(i < first ? input.point_mm(output.from[i])
                               : Vec3(input.origin_mm + output.new_points_mm[i - first]));
  Result<cloud::Cloud> made = cloud::build_cloud(points, cloud::NonFinite::kRefuse);
  if (!made) return made;
  for (const cloud::Property& property : input.properties)
    made->properties.push_back({property.name, cloud::taken(property.values, output.from)});
  if (is_in_order(output.from, input.size())) made->raster = input.raster;
  return made;
}

std::string change(std::string_view step, std::size_t before, const CleaningStepOutput& output) {
  const std::size_t moved = output.new_points_mm.size(), after = output.from.size();
  std::string text = after < before ? fmt::format("{}: {} of {} points removed", step, before - after, before)
                     : after > before ? fmt::format("{}: {} points added to {}", step, after - before, before)
                     : moved > 0      ? fmt::format("{}: {} points moved", step, moved)
                                      : fmt::format("{}: nothing changed in {} points", step, before);
  if (!output.note.empty()) text += "; " + output.note;
  return text;
}

}  // namespace

void Cleaning::add(CleaningStep step) {
  assert(find(step.name) == nullptr);
  steps_.push_back(std::move(step));
}

const CleaningStep* Cleaning::find(std::string_view name) const noexcept {
  const auto at =
      std::find_if(steps_.begin(), steps_.end(), [&](const CleaningStep& s) { return s.name == name; });
  return at == steps_.end() ? nullptr : &*at;
}

Result<NamedOptions> Cleaning::check(const NamedOptions& step) const {
  const CleaningStep* const found = find(step.name);
  if (found == nullptr)
    return Error{fmt::format("there is no cleaning step '{}'", step.name),
                 did_you_mean(step.name, names_of(steps_), choices_of(steps_))};
  PALPATE_ASSIGN(Options options, validate(step.options, found->options, step.name));
  return NamedOptions{step.name, std::move(options)};
}

Result<std::vector<NamedOptions>> Cleaning::parse(std::string_view text) const {
  std::vector<NamedOptions> steps;
  for (std::string& item : split_list(text, '+')) {
    std::replace(item.begin(), item.end(), '/', ':');
    PALPATE_ASSIGN(const NamedOptions named, parse_named_options(item));
    PALPATE_ASSIGN(NamedOptions step, check(named));
    steps.push_back(std::move(step));
  }
  if (steps.empty()) return Error{"cleaning needs a step", choices_of(steps_) + ", joined by +"};
  return steps;
}

Result<CleanedCloud> Cleaning::run(const cloud::Cloud& cloud, std::span<const NamedOptions> steps,
                                   int threads, Progress& progress) const {
  CleanedCloud cleaned{cloud, std::vector<std::uint32_t>(cloud.size()), {}, {}};
  std::iota(cleaned.from.begin(), cleaned.from.end(), 0u);
  for (const NamedOptions& step : steps) {
    const CleaningStep* const found = find(step.name);
    if (found == nullptr) return check(step).error();
    const std::string phase = "cleaning: " + step.name;
    progress.report(phase, -1.0);
    if (progress.cancelled()) return Error{"stopped while cleaning"};
    const Stopwatch watch;
    const cloud::Cloud& before = cleaned.cloud;
    PALPATE_ASSIGN(CleaningStepOutput output,
                   found->run({before, step.options, search::mean_spacing_mm(before), threads, progress}));
    if (output.from.empty())
      return Error{fmt::format("{} would remove every one of {} points", step.name, before.size()),
                   "give it wider limits; lengths are in spacings"};
    find_sources(before, output);
    Result<cloud::Cloud> after = apply(before, output);
    if (!after) return Error{step.name + ": " + after.error().what, after.error().remedy};
    cleaned.notes.push_back(change(step.name, before.size(), output));
    for (std::uint32_t& i : output.from) i = cleaned.from[i];
    cleaned.from = std::move(output.from);
    cleaned.cloud = *std::move(after);
    cleaned.phases.push_back({phase, watch.ms()});
  }
  return cleaned;
}

}  // namespace palpate::scene
