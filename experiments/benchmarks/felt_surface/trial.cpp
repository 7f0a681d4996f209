#include "experiments/benchmarks/felt_surface/trial.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <limits>
#include <optional>

#include <palpate/clock.h>
#include <palpate/generate.h>
#include <palpate/replay.h>
#include <palpate/result.h>
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"

namespace palpate::felt {
namespace {

class TimeLimit final : public Progress {
 public:
  explicit TimeLimit(double limit_s) : limit_s_(limit_s) {}
  void report(std::string_view, double) override {}
  [[nodiscard]] bool cancelled() const override { return limit_s_ > 0.0 && watch_.ms() > 1e3 * limit_s_; }

 private:
  double limit_s_;
  Stopwatch watch_;
};

/// Mean over the truth's contact frames, ns: one clock pair per run of them, as in replay.h.
double contact_pass(render::HapticRenderer& renderer, const Ground& ground) {
  const trace::ProbePath& path = ground.path;
  renderer.restart(path.hip_mm.front(), -kStepS);
  std::int64_t ns = 0;
  std::uint64_t frames = 0;
  for (std::size_t i = 0; i < path.size();) {
    const bool contact = ground.reference.frames[i].frame.contact;
    std::size_t end = i;
    while (end < path.size() && ground.reference.frames[end].frame.contact == contact) ++end;
    const std::int64_t start = monotonic_ns();
    for (std::size_t k = i; k < end; ++k) static_cast<void>(renderer.step(path.hip_mm[k], path.t_s[k]));
    if (contact) {
      ns += monotonic_ns() - start;
      frames += end - i;
    }
    i = end;
  }
  return frames > 0 ? static_cast<double>(ns) / static_cast<double>(frames) : 0.0;
}

double whole_pass(render::HapticRenderer& renderer, const trace::ProbePath& path) {
  renderer.restart(path.hip_mm.front(), -kStepS);
  const std::int64_t start = monotonic_ns();
  for (std::size_t k = 0; k < path.size(); ++k) static_cast<void>(renderer.step(path.hip_mm[k], path.t_s[k]));
  return static_cast<double>(monotonic_ns() - start) / static_cast<double>(path.size());
}

/// Net generated energy of each loop, relative to its work.
[[nodiscard]] Status run_loops(render::HapticRenderer& renderer, const std::vector<trace::ProbePath>& loops,
                               Row& row) {
  double generated = 0.0, work = 0.0, worst = 0.0;
  for (const trace::ProbePath& loop : loops) {
    PALPATE_ASSIGN(const trace::ForceTrace trace, trace::replay(renderer, loop));
    double put_in = 0.0, moved = 0.0;
    for (std::size_t i = 1; i < loop.size(); ++i) {
      const double e =
          -0.5 *
          (trace.frames[i - 1].force_n + trace.frames[i].force_n).dot(loop.hip_mm[i] - loop.hip_mm[i - 1]);
      put_in += e;
      moved += 0.5 * std::abs(e);  // half of it in, half of it out
    }
    const double made = std::max(0.0, -put_in);
    generated += made;
    work += moved;
    if (moved > 0.0) worst = std::max(worst, 100.0 * made / moved);
  }
  if (!(work > 0.0)) return Done{};
  row.loop_energy_percent = 100.0 * generated / work;
  row.worst_loop_percent = worst;
  return Done{};
}

/// The median over all contact frames; the RMS over uncaught true contact; and the caught frames' share of
/// the error.
void look_at_errors(const Ground& ground, const trace::ForceTrace& trace, Row& row) {
  std::vector<double> errors;
  double error_sq = 0.0, force_sq = 0.0, caught_sq = 0.0;
  for (std::size_t i = 0; i < trace.frames.size(); ++i) {
    const trace::TruthFrame& truth = ground.reference.frames[i];
    const double error = (trace.frames[i].force_n - truth.frame.force_n).norm();
    if (error > 0.0 || truth.frame.contact) errors.push_back(error);
    if (!truth.frame.contact) continue;
    if (ground.caught[i] != 0) {
      ++row.caught_frames;
      caught_sq += error * error;
      continue;
    }
    error_sq += error * error;
    force_sq += truth.frame.force_n.squaredNorm();
  }
  if (force_sq > 0.0) row.uncaught_rms_percent = 100.0 * std::sqrt(error_sq / force_sq);
  if (error_sq + caught_sq > 0.0) row.caught_error_percent = 100.0 * caught_sq / (error_sq + caught_sq);
  if (errors.empty()) return;
  const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
  std::nth_element(errors.begin(), middle, errors.end());
  row.median_error_n = *middle;
}

/// Frames above this share of the largest error belong to a mistake.
constexpr double kMistaken = 0.1;

/// Runs of frames with the most error, the worst `most`.
std::vector<Mistake> worst_mistakes(const Ground& ground, const trace::ForceTrace& trace, std::size_t most) {
  std::vector<Mistake> all;
  double sum = 0.0, largest = 0.0;
  const auto error_at = [&](std::size_t i) {
    return (trace.frames[i].force_n - ground.reference.frames[i].frame.force_n).norm();
  };
  for (std::size_t i = 0; i < trace.frames.size(); ++i) {
    sum += error_at(i) * error_at(i);
    largest = std::max(largest, error_at(i));
  }
  for (std::size_t i = 0; i < trace.frames.size();) {
    Mistake run{i, i, 0.0};
    double worst = 0.0;
    for (; run.end < trace.frames.size() && error_at(run.end) > kMistaken * largest; ++run.end) {
      const double error = error_at(run.end);
      run.share += error * error / sum;
      if (!(error > worst)) continue;
      worst = error;
      run.hip_mm = ground.path.hip_mm[run.end];
      run.true_god_mm = ground.reference.frames[run.end].frame.god_object_mm;
      run.felt_god_mm = trace.frames[run.end].god_object_mm;
      run.true_contact = ground.reference.frames[run.end].frame.contact;
      run.felt_contact = trace.frames[run.end].contact;
    }
    i = run.end + 1;
    if (run.end > run.begin) all.push_back(run);
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const Mistake& a, const Mistake& b) { return a.share > b.share; });
  if (all.size() > most) all.resize(most);
  return all;
}

void look_at_free_frames(const Ground& ground, const trace::ForceTrace& trace, Row& row) {
  std::size_t free = 0, held = 0;
  for (std::size_t i = 0; i < trace.frames.size(); ++i) {
    const trace::TruthFrame& truth = ground.reference.frames[i];
    // Without any truth no force may occur, however near.
    const double near_mm = ground.truth == nullptr ? 0.0 : truth.local_resolution_mm;
    if (truth.frame.contact || !(truth.signed_distance_mm > near_mm)) continue;
    ++free;
    const double force = trace.frames[i].force_n.norm();
    held += force > 0.0;
    row.free_force_n = std::max(row.free_force_n, force);
  }
  if (free > 0) row.held_share = 100.0 * static_cast<double>(held) / static_cast<double>(free);
}

[[nodiscard]] Status run(const Ground& ground, const NamedOptions& named,
                         const std::vector<trace::ProbePath>& loops, const render::Registry& registry,
                         const TrialOptions& options, Row& row) {
  if (registry.find(named.name) == nullptr)
    return Error{"there is no renderer of this name", "see palpate list renderers"};
  PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> renderer,
                 registry.make(named.name, named.options));
  TimeLimit limit(options.prepare_limit_s);
  const std::clock_t began = std::clock();
  PALPATE_ASSIGN(const render::PrepareReport prepared,
                 renderer->prepare(ground.scene, {options.threads, &limit}));
  row.prepare_cpu_ms = 1e3 * static_cast<double>(std::clock() - began) / CLOCKS_PER_SEC;
  row.prepare_ms = prepared.total_ms;
  row.bytes_per_point = static_cast<double>(prepared.bytes) / static_cast<double>(row.points);
  row.warnings = prepared.warnings;

  PALPATE_ASSIGN(const trace::ReplayReport replayed, trace::measure(*renderer, ground.path, {}));
  row.trace_hash = replayed.trace_hash;
  row.bound_hits = replayed.counters.bound_hits;
  row.p999_us = replayed.all ? replayed.all->p999_us : std::nullopt;
  metrics::AccuracyOptions scoring;
  scoring.stiffness_n_per_mm = kStiffness;
  scoring.stored_rounding_mm = cloud::stored_rounding_mm(ground.points());
  PALPATE_ASSIGN(row.accuracy,
                 metrics::score(ground.path, replayed.trace, ground.reference, ground.truth.get(), scoring));
  PALPATE_ASSIGN(const metrics::Energy energy,
                 metrics::observe_energy(ground.path, replayed.trace, kStiffness));
  row.energy_percent = energy.generated_percent;
  look_at_errors(ground, replayed.trace, row);
  look_at_free_frames(ground, replayed.trace, row);
  if (options.mistakes > 0) row.mistakes = worst_mistakes(ground, replayed.trace, options.mistakes);
  row.contact_ns = row.all_ns = std::numeric_limits<double>::infinity();
  for (int pass = 0; pass < options.timed_passes; ++pass) {
    row.contact_ns = std::min(row.contact_ns, contact_pass(*renderer, ground));
    row.all_ns = std::min(row.all_ns, whole_pass(*renderer, ground.path));
  }
  return run_loops(*renderer, loops, row);
}

}  // namespace

Result<std::vector<Tried>> read_tried(const std::string& list) {
  std::vector<Tried> all;
  const std::vector<std::string> texts = split_list(list);
  for (const std::string& text : texts) {
    PALPATE_ASSIGN(const NamedOptions named, parse_named_options(text));
    Tried tried{named.name, {named.name, {}}};
    for (const auto& [key, value] : named.options.all())
      if (key == "label")
        tried.label = value;
      else
        tried.spec.options.set(key, value);
    all.push_back(std::move(tried));
  }
  for (std::size_t i = 0; i < all.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      if (all[i].label == all[j].label) all[i].label = texts[i];
  return all;
}

Row run_trial(const DataSet& set, const Ground& ground, const Tried& tried,
              const std::vector<trace::ProbePath>& loops, const render::Registry& registry,
              const TrialOptions& options) {
  Row row;
  row.set = set.name;
  row.renderer = tried.label;
  row.points = ground.points().size();
  row.spacing_mm = ground.spacing_mm;
  if (const Status done = run(ground, tried.spec, loops, registry, options, row); !done.ok())
    row.failed = done.error().message();
  return row;
}

namespace {

/// A slice of the plane y = 0. The probe moves along `down` in every column.
struct View {
  std::string name, title, generate;
  Vec3 middle, down;
  double wide_mm = 4.0, high_mm = 2.0;
};

const std::vector<View>& views() {
  static const std::vector<View> kAll = {
      {"edge",
       "a round edge of 2 mm",
       "rounded-box:points=15000:sampling=blue:mesh=false",
       {18.4, 0, 8.4},
       Vec3(-1, 0, -1).normalized(),
       7.0,
       3.0},
      {"hole",
       "the rim of a mouth, to the left of it nothing",
       "bowl:rim_deg=150:felt=outside:points=12000:sampling=blue:mesh=false",
       {12.5, 0, 21.65},
       Vec3(-0.5, 0, -std::sqrt(0.75)),
       8.0,
       3.5},
      {"thin",
       "two sheets a spacing and a half apart",
       "shells:extent_mm=32:gap_mm=0.6:points=40000:sampling=blue:mesh=false",
       {0, 0, 15.7},
       {0, 0, -1},
       5.0,
       2.2},
      {"noise",
       "noise of .22 spacings",
       "torus:points=60000:sampling=blue:noise=0.22:mesh=false",
       {37.037, 0, 12.963},
       {0, 0, -1},
       7.0,
       3.0},
  };
  return kAll;
}

constexpr int kColumns = 280, kSteps = 240;
/// Jumps between two columns above this share of the width are drawn as gaps.
constexpr double kGap = 0.05;
constexpr double kPixelsWide = 900.0, kLegendPixels = 24.0;
constexpr std::array kColours = {"#c0392b", "#2471a3", "#7d3c98", "#b9770e", "#117a65", "#5d6d7e"};

using Locus = std::vector<std::optional<Vec3>>;

class Canvas {
 public:
  explicit Canvas(const View& view)
      : view_(view), across_(-view.down.z(), 0.0, view.down.x()), scale_(kPixelsWide / view.wide_mm) {
    // Rightwards, seen with the probe coming from above.
    if (across_.x() < 0.0) across_ = -across_;
  }
  [[nodiscard]] double pixels_high() const { return view_.high_mm * scale_; }
  /// The probe's path in a column, from its free end.
  [[nodiscard]] Vec3 place(int column, double share_down) const {
    const double x = (static_cast<double>(column) + 0.5) / kColumns - 0.5;
    return view_.middle + x * view_.wide_mm * across_ + (share_down - 0.5) * view_.high_mm * view_.down;
  }
  [[nodiscard]] std::string at(const Vec3& p) const {
    const Vec3 r = p - view_.middle;
    return fmt::format("{:.1f},{:.1f}", 0.5 * kPixelsWide + scale_ * r.dot(across_),
                       0.5 * pixels_high() + scale_ * r.dot(view_.down));
  }
  void points(const cloud::Cloud& cloud, double thick_mm) {
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Vec3 p = cloud.point_mm(i), r = p - view_.middle;
      if (std::abs(p.y()) > thick_mm || std::abs(r.dot(across_)) > 0.5 * view_.wide_mm ||
          std::abs(r.dot(view_.down)) > 0.5 * view_.high_mm)
        continue;
      const std::string at_pixel = at(p);
      const std::size_t comma = at_pixel.find(',');
      body_ += fmt::format("<circle cx=\"{}\" cy=\"{}\" r=\"2.5\" fill=\"#999\"/>\n",
                           at_pixel.substr(0, comma), at_pixel.substr(comma + 1));
    }
  }
  void locus(const Locus& locus, const std::string& label, const char* colour, double width) {
    std::string line;
    std::optional<Vec3> last;
    const auto end_line = [&] {
      if (!line.empty())
        body_ += fmt::format("<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\"/>\n",
                             line, colour, width);
      line.clear();
    };
    for (const std::optional<Vec3>& p : locus) {
      if (last && (!p || (*p - *last).norm() > kGap * view_.wide_mm)) end_line();
      if (p) line += at(*p) + " ";
      last = p;
    }
    end_line();
    legend_ += fmt::format("<text x=\"{:.0f}\" y=\"{:.0f}\" fill=\"{}\">{}</text>\n",
                           10.0 + 170.0 * labels_++, pixels_high() + 0.7 * kLegendPixels, colour, label);
  }
  [[nodiscard]] std::string svg() const {
    const double high = pixels_high() + kLegendPixels;
    return fmt::format(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0:.0f} {1:.0f}\" width=\"{0:.0f}\" "
        "height=\"{1:.0f}\" font-family=\"sans-serif\" font-size=\"14\">\n<title>{2}</title>\n"
        "<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
        "<clipPath id=\"window\"><rect width=\"{0:.0f}\" height=\"{3:.0f}\"/></clipPath>\n"
        "<g clip-path=\"url(#window)\">\n{4}</g>\n{5}"
        "<path d=\"M{6:.0f},{7:.0f} h{8:.1f}\" stroke=\"black\" stroke-width=\"2\"/>\n"
        "<text x=\"{6:.0f}\" y=\"{9:.0f}\">1 mm</text>\n</svg>\n",
        kPixelsWide, high, view_.title, pixels_high(), body_, legend_, 10.0, pixels_high() - 10.0, scale_,
        pixels_high() - 16.0);
  }

 private:
  const View& view_;
  Vec3 across_;
  double scale_;
  int labels_ = 0;
  std::string body_, legend_;
};

/// God object of the first contact frame per column.
Locus touched(render::HapticRenderer& renderer, const Canvas& canvas) {
  Locus locus(kColumns);
  for (int column = 0; column < kColumns; ++column) {
    renderer.restart(canvas.place(column, 0.0), -kStepS);
    for (int k = 0; k <= kSteps; ++k) {
      const render::Frame frame =
          renderer.step(canvas.place(column, static_cast<double>(k) / kSteps), kStepS * k);
      if (!frame.contact) continue;
      locus[static_cast<std::size_t>(column)] = frame.god_object_mm;
      break;
    }
  }
  return locus;
}

}  // namespace

Status draw_slice(const std::string& name, const std::vector<Tried>& renderers,
                  const render::Registry& registry, const std::string& file) {
  const View* view = nullptr;
  for (const View& one : views())
    if (one.name == name) view = &one;
  if (view == nullptr)
    return Error{fmt::format("there is no slice '{}'", name), "choose from " + joined(names_of(views()))};
  PALPATE_ASSIGN(cloud::GeneratedModel made, cloud::generate(parse_named_options(view->generate).value()));
  render::ModelInput model;
  model.name = name;
  model.cloud = std::make_shared<const cloud::Cloud>(made.cloud);
  model.surface.stiffness_n_per_mm = kStiffness;
  render::SceneInput scene;
  scene.models.push_back(model);

  Canvas canvas(*view);
  canvas.points(made.cloud, 0.5 * made.nominal_spacing_mm);
  Locus truth(kColumns);
  for (int column = 0; column < kColumns; ++column)
    if (const auto entry = made.surface->first_entry(canvas.place(column, 0.0), canvas.place(column, 1.0)))
      truth[static_cast<std::size_t>(column)] = entry->point_mm;
  canvas.locus(truth, "truth", "#000", 1.0);
  std::size_t colour = 0;
  for (const Tried& tried : renderers) {
    PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> renderer,
                   registry.make(tried.spec.name, tried.spec.options));
    PALPATE_TRY(renderer->prepare(scene, {}));
    canvas.locus(touched(*renderer, canvas), tried.label, kColours[colour++ % kColours.size()], 1.6);
  }
  return write_file(file, canvas.svg());
}

}  // namespace palpate::felt
