#include "experiments/run/disagreement.h"

#include <fmt/format.h>

#include <algorithm>

#include <palpate/accuracy.h>
#include "toolkit/core/message_text.h"
#include "toolkit/core/number_format.h"

namespace palpate::experiments {
namespace {

constexpr std::size_t kShownStretches = 3;

/// Who is apart in a frame.
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
