#include "experiments/benchmarks/felt_surface/ablation.h"

#include <array>
#include <functional>
#include <utility>

#include "experiments/benchmarks/felt_surface/plain_god.h"
#include "toolkit/renderers/cloud_on_stars.h"

namespace palpate::felt {
namespace {

using Make = std::function<std::unique_ptr<render::HapticRenderer>(const Options&)>;

struct Ablation {
  const char* whole;  ///< whose options it has
  std::string name;
  Make make;
};

struct Step {
  const char* name;
  bool stars::StarsWithout::*left_out;
};

constexpr std::array<Step, 6> kStarSteps = {{{"mending", &stars::StarsWithout::mending},
                                             {"flat", &stars::StarsWithout::flat},
                                             {"filling", &stars::StarsWithout::filling},
                                             {"remaking", &stars::StarsWithout::remaking},
                                             {"borders", &stars::StarsWithout::borders},
                                             {"crossings", &stars::StarsWithout::crossings}}};

std::vector<Ablation> ablations() {
  std::vector<Ablation> all;
  for (const auto& step : kStarSteps)
    all.push_back({"cloud", std::string("cloud-without-") + step.name, [&step](const Options& options) {
                     stars::StarsWithout without;
                     without.*step.left_out = true;
                     return render::make_cloud_on_stars(options, without);
                   }});
  const auto plain = [&](const char* name, const PlainRules& rules) {
    all.push_back({"cloud", name, [rules](const Options&) { return make_plain_god(rules); }});
  };
  plain("cloud-plain", {});
  plain("cloud-plain-without-segment", {false, true});
  plain("cloud-plain-without-pseudonormal", {true, false});
  return all;
}

}  // namespace

void add_ablations(render::Registry& registry) {
  for (Ablation& ablation : ablations()) {
    render::RendererInfo info = *registry.find(ablation.whole);
    info.name = std::move(ablation.name);
    info.make = std::move(ablation.make);
    registry.add(std::move(info));
  }
}

std::string ablated_renderers() {
  std::string text = "cloud,cloud:refine=1:label=cloud-refined";
  for (const Ablation& ablation : ablations()) text += "," + ablation.name;
  return text;
}

std::vector<std::string> ablation_sets() {
  return {"trand", "tnoise", "rbox", "roof20", "near", "mouth", "thin15", "cross", "dragonn", "border"};
}

}  // namespace palpate::felt
