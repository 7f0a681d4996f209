#include "experiments/hunt/found.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include <palpate/result.h>
#include <palpate/trace.h>
#include <palpate/write_mesh.h>
#include "experiments/hunt/hand_scene.h"

namespace palpate::experiments {
namespace {

using Json = nlohmann::ordered_json;

std::string dumped(const Json& json, int indent = -1) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

std::string case_name(const Quest& quest, const std::string& what) {
  return quest.renderer.label + "-" + what;
}
std::string fault_name(std::size_t k) {
  return fmt::format("fault-{}", k + 1);
}

}  // namespace

std::string to_text(const HuntState& state) {
  Json quests = Json::array();
  for (const Quest& quest : state.quests) {
    Json worst = Json::object(), faults = Json::array();
    for (std::size_t g = 0; g < kGoals; ++g)
      if (const auto& found = quest.worst[g])
        worst[info_of(static_cast<HuntGoal>(g)).name] = {{"score", found->score},
                                                         {"trial", found->trial},
                                                         {"frame", found->frame},
                                                         {"quarry", to_text(found->quarry)}};
    for (const Fault& fault : quest.faults)
      faults.push_back({{"what", fault.what}, {"trial", fault.trial}, {"quarry", to_text(fault.quarry)}});
    quests.push_back({{"label", quest.renderer.label},
                      {"trials", quest.trials},
                      {"refused", quest.refused},
                      {"bound_hits", quest.bound_hits},
                      {"faulty", quest.faulty},
                      {"worst", worst},
                      {"faults", faults}});
  }
  return dumped({{"next_trial", state.next_trial}, {"spent_s", state.spent_s}, {"quests", quests}});
}

bool from_text(const std::string& text, HuntState& state) {
  HuntState read = state;
  try {
    const nlohmann::json json = nlohmann::json::parse(text);
    json.at("next_trial").get_to(read.next_trial);
    json.at("spent_s").get_to(read.spent_s);
    if (json.at("quests").size() != read.quests.size()) return false;
    for (std::size_t q = 0; q < read.quests.size(); ++q) {
      const nlohmann::json& from = json.at("quests").at(q);
      Quest& quest = read.quests[q];
      if (from.at("label") != quest.renderer.label) return false;
      from.at("trials").get_to(quest.trials);
      from.at("refused").get_to(quest.refused);
      from.at("bound_hits").get_to(quest.bound_hits);
      from.at("faulty").get_to(quest.faulty);
      for (std::size_t g = 0; g < kGoals; ++g) {
        const char* const name = info_of(static_cast<HuntGoal>(g)).name;
        if (!from.at("worst").contains(name)) continue;
        const nlohmann::json& one = from.at("worst").at(name);
        Found found{one.at("score").get<double>(),
                    one.at("trial").get<std::uint64_t>(),
                    one.at("frame").get<std::size_t>(),
                    {}};
        if (!from_text(one.at("quarry").get<std::string>(), found.quarry)) return false;
        quest.worst[g] = std::move(found);
      }
      for (const nlohmann::json& one : from.at("faults")) {
        Fault fault{one.at("what").get<std::string>(), one.at("trial").get<std::uint64_t>(), {}};
        if (!from_text(one.at("quarry").get<std::string>(), fault.quarry)) return false;
        quest.faults.push_back(std::move(fault));
      }
    }
  } catch (const nlohmann::json::exception&) {
    return false;
  }
  state = std::move(read);
  return true;
}

NamedOptions renderer_of(const Quest& quest, const Quarry& quarry) {
  NamedOptions named{quest.renderer.name, quest.renderer.options};
  for (const auto& [key, value] : quarry.options.all()) named.options.set(key, value);
  return named;
}

Status write_case(const OutputFolder& folder, const std::string& name, const Quarry& quarry,
                  const NamedOptions& renderer) {
  PALPATE_ASSIGN(const HuntScene scene, make_scene(quarry));
  PALPATE_ASSIGN(const std::string path, folder.claim(name + ".csv"));
  PALPATE_TRY(trace::write_path_csv(scene.path, path));
  std::string text;
  if (quarry.hand) {
    PALPATE_ASSIGN(text, hand_scene_toml(quarry));
  } else {
    PALPATE_ASSIGN(const std::string cloud, folder.claim(name + ".ply"));
    PALPATE_TRY(io::write_cloud_ply(cloud, *scene.input.models[0].cloud));
    text = fmt::format("[[model]]\ncloud = \"{}.ply\"\n", name) + surface_toml(quarry);
  }
  text += fmt::format("[renderer]\nname = \"{}\"\n", renderer.name) + toml_lines(renderer.options);
  return folder.write(name + ".toml", text);
}

std::string command_of(const OutputFolder& folder, const std::string& name) {
  const std::string at = folder.file(name).string();
  return fmt::format("palpate compare {0}.toml --renderers auto --path {0}.csv --out {0}", at);
}

Result<std::string> write_found(const OutputFolder& folder, const HuntState& state, std::uint64_t seed) {
  Json renderers = Json::array();
  for (const Quest& quest : state.quests) {
    Json worst = Json::array(), faults = Json::array();
    const auto write = [&](const std::string& name, const Quarry& quarry) -> Result<Json> {
      PALPATE_TRY(write_case(folder, name, quarry, renderer_of(quest, quarry)));
      return Json{{"case", name + ".toml"}, {"command", command_of(folder, name)}};
    };
    for (std::size_t g = 0; g < kGoals; ++g) {
      const auto& found = quest.worst[g];
      if (!found || !(found->score > 0.0)) continue;
      const GoalInfo& goal = info_of(static_cast<HuntGoal>(g));
      PALPATE_ASSIGN(Json one, write(case_name(quest, goal.name), found->quarry));
      Json row = {
          {"goal", goal.name}, {"score", found->score}, {"trial", found->trial}, {"frame", found->frame}};
      row.update(one);
      worst.push_back(std::move(row));
    }
    for (std::size_t k = 0; k < quest.faults.size(); ++k) {
      PALPATE_ASSIGN(Json one, write(case_name(quest, fault_name(k)), quest.faults[k].quarry));
      Json row = {{"what", quest.faults[k].what}, {"trial", quest.faults[k].trial}};
      row.update(one);
      faults.push_back(std::move(row));
    }
    renderers.push_back({{"label", quest.renderer.label},
                         {"name", quest.renderer.name},
                         {"trials", quest.trials},
                         {"refused", quest.refused},
                         {"bound_hits", quest.bound_hits},
                         {"broken", quest.faulty},
                         {"worst", worst},
                         {"faults", faults}});
  }
  const std::string text = dumped({{"schema", "palpate-hunt-1"},
                                   {"seed", seed},
                                   {"trials", state.next_trial},
                                   {"spent_s", state.spent_s},
                                   {"renderers", renderers}},
                                  1) +
                           "\n";
  PALPATE_TRY(folder.write("hunt.json", text));
  return text;
}

}  // namespace palpate::experiments
