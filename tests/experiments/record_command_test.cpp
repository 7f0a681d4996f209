// Recordings made, compared and exported as a user does; and their hashes, segment by segment.

#include <nlohmann/json.hpp>

#ifdef PALPATE_WITH_HDF5
#include <hdf5.h>
#endif

#include <palpate/trace.h>
#include "device/record/recorder.h"
#include "device/simulated/simulated_device.h"
#include "experiments/live/recording_session.h"
#include "experiments/run/arguments.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

/// A stage and renderers on it, as the commands make them.
struct Prepared {
  render::Registry registry = all_renderers();
  Stage stage;
  RendererRequest request;
};

Prepared prepared_stage(const std::string& renderer, const std::string& path) {
  Prepared p;
  ProgressBar progress;
  RunArguments run;
  run.scene = kSmallWaves;
  run.renderers = renderer;
  run.path = path;
  run.reference = "none";
  auto checked = value_of(check_run(run, p.registry, progress));
  p.request = checked.renderers.front();
  p.stage = value_of(set_up(checked.stage, all_readers(), progress));
  return p;
}

std::unique_ptr<render::HapticRenderer> fresh(const Prepared& p) {
  return value_of(prepared_renderer(p.request, p.registry, p.stage.scene, 1, false, no_progress()));
}

/// The path under a device that fails three times: silent in contact, out of reach, without a position.
void record_with_faults(const Prepared& p, const std::string& file) {
  VirtualClock clock;
  geometry::RigidTransform world_from_device;
  world_from_device.translation_mm = Vec3{0.1, -0.2, 1.0 / 3.0};
  world_from_device.rotation = Eigen::AngleAxisd(0.3, Vec3(Vec3::UnitZ()));
  trace::ProbePath path = p.stage.path;
  for (Vec3& hip_mm : path.hip_mm) hip_mm = world_from_device.inverse() * hip_mm;
  const device::DeviceLimits limits{3.3, {Vec3::Constant(-200.0), Vec3::Constant(200.0)}, 0.01, 1000.0};
  using Kind = device::ScriptedFault::Kind;
  device::SimulatedDevice device(path, clock, limits, 0,
                                 {{Kind::kSilence, 0.40, 0.1, Vec3::Zero()},
                                  {Kind::kJump, 1.35, 0.05, Vec3{60.0, 0.0, 0.0}},
                                  {Kind::kNonFinitePosition, 2.25, 0.05, Vec3::Zero()}});
  device::GovernorOptions governing;
  const auto renderer = fresh(p);
  device::RendererTap tap(*renderer, clock);
  device::TapSource source({&tap}, world_from_device);
  device::RecordingHeader header;
  header.world_from_device = world_from_device;
  auto recorder = value_of(device::Recorder::create(file, header, source));
  const auto recorded = value_of(recorded_renderer(p.request, p.registry));
  ASSERT_TRUE(recorder->add_renderer(recorded));
  device::Servo servo(tap, governing, device, clock, world_from_device);
  ASSERT_TRUE(servo.start(p.stage.path.hip_mm.front()));
  int faulted = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    clock.advance_to(static_cast<std::int64_t>(i) * 1'000'000);
    const device::Tick tick = servo.tick();
    recorder->took(tick);
    faulted = tick.fault == device::Fault::kNone ? 0 : faulted + 1;
    if (faulted == 150) servo.rearm();
  }
  servo.stop();
  ASSERT_TRUE(recorder->finish());
}

class RecordSegments : public OnCommandLine, public testing::WithParamInterface<const char*> {};

TEST_P(RecordSegments, AnswerTheSameBitsWithFaultsAndStartsInContactBetween) {
  const Prepared p = prepared_stage(GetParam(), "weave:frames=3200:depth_mm=1.5");
  const std::string file = in("faults.palrec");
  record_with_faults(p, file);
  auto recording = value_of(device::Recording::open(file));
  const auto renderer = fresh(p);
  const auto segments = value_of(replay_segments(recording, "", *renderer, no_progress()));
  EXPECT_TRUE(recording.end().warnings().empty());
  ASSERT_EQ(segments.size(), 4u) << "three faults";
  std::uint64_t contact = 0;
  bool from_contact = false;
  for (const SegmentReplay& segment : segments) {
    EXPECT_TRUE(segment.whole);
    EXPECT_TRUE(segment.brought_up);
    EXPECT_EQ(segment.recorded_hash, segment.replayed_hash) << segments_text(segments);
    contact += segment.contact_frames;
    from_contact = from_contact || segment.starts_in_contact;
  }
  EXPECT_GT(contact, 500u);
  EXPECT_TRUE(from_contact) << segments_text(segments);
  // Another renderer answers other bits: the comparison can fail.
  Prepared other = prepared_stage("cloud:refine=1", "weave:frames=10");
  auto again = value_of(device::Recording::open(file));
  const auto different = value_of(replay_segments(again, "", *fresh(other), no_progress()));
  EXPECT_FALSE(different.front().same());
  EXPECT_GE(different.front().differs_ns, 0);
}

INSTANTIATE_TEST_SUITE_P(Renderers, RecordSegments,
                         testing::Values("cloud", "cloud-smooth", "mesh-godobject"));

class RecordedFaults : public InFolder {
 protected:
  RecordedFaults() { record_with_faults(p, file); }
  const Prepared p = prepared_stage("cloud", "weave:frames=3200:depth_mm=1.5");
  const std::string file = in("faults.palrec");
};

TEST_F(RecordedFaults, ArePathsThatStartFreeAndGoByThePlacesOfBringUps) {
  const auto recorded = value_of(path_of_recording(file, kMemoryLimitBytes));
  EXPECT_TRUE(recorded.warnings.empty());
  EXPECT_EQ(recorded.path.hip_mm.front(), p.stage.path.hip_mm.front());
  EXPECT_GT(recorded.path.size(), 2000u);
  for (std::size_t i = 1; i < recorded.path.size(); ++i)
    ASSERT_GT(recorded.path.t_s[i], recorded.path.t_s[i - 1]) << i;
}

TEST_F(RecordedFaults, AreCountedAndSoAreSegments) {
  const auto facts = value_of(facts_of_recording(file, false));
  EXPECT_EQ(facts.end.ticks, p.stage.path.size());
  EXPECT_NEAR(facts.length_s, 1e-3 * static_cast<double>(p.stage.path.size() - 1), 1e-9);
  EXPECT_EQ(facts.segments, 4u) << "three faults";
  ASSERT_EQ(facts.faults.size(), 3u);
  const std::pair<device::Fault, double> scripted[] = {{device::Fault::kSilence, 0.40},
                                                       {device::Fault::kJump, 1.35},
                                                       {device::Fault::kNonFinitePosition, 2.25}};
  for (std::size_t i = 0; i < facts.faults.size(); ++i) {
    EXPECT_EQ(facts.faults[i].name, device::fault_name(scripted[i].first));
    EXPECT_EQ(facts.faults[i].times, 1u);
    EXPECT_GE(facts.faults[i].first_s, scripted[i].second);
    EXPECT_LE(facts.faults[i].first_s, scripted[i].second + 0.03) << "found within 30 ms";
  }
  ASSERT_EQ(facts.renderers.size(), 1u);
  // The same counts, by another way.
  std::uint64_t stepped = 0, contact = 0;
  double force_n = 0.0;
  auto recording = value_of(device::Recording::open(file));
  device::RecordedTick tick;
  for (Result<bool> more = recording.next(tick); more && *more; more = recording.next(tick)) {
    stepped += tick.tracks[0].stepped;
    contact += tick.tracks[0].stepped && tick.tracks[0].frame.contact;
    force_n = std::max(force_n, tick.sent_n.norm());
  }
  const RecordedRendererFacts& renderer = facts.renderers.front();
  EXPECT_EQ(renderer.renderer.name, "cloud");
  EXPECT_EQ(renderer.ticks, stepped);
  EXPECT_LT(renderer.ticks, facts.end.ticks) << "not stepped in a fault";
  EXPECT_EQ(renderer.contact_ticks, contact);
  EXPECT_GT(contact, 500u);
  EXPECT_EQ(facts.force_max_n, force_n);
  EXPECT_GT(force_n, 0.1);
}

class RecordCommand : public OnCommandLine {
 protected:
  /// Two seconds on a virtual clock.
  template <class... More>
  Words record(const std::string& out, const More&... more) const {
    return words("live record", kSmallWaves,
                 "--renderer cloud --seconds 2 --path weave:frames=2000:depth_mm=1", "--accelerated --out",
                 in(out), more...);
  }
  json document(const std::string& file) const { return json_in(file); }
  /// Turns a bit in the middle.
  static void damage(const std::string& name) {
    std::fstream file(name, std::ios::in | std::ios::out | std::ios::binary);
    const auto middle = static_cast<std::streamoff>(std::filesystem::file_size(name) / 2);
    file.seekg(middle);
    const char before = static_cast<char>(file.get());
    file.seekp(middle);
    file.put(static_cast<char>(before ^ 1));
  }
  template <class... Parts>
  void refused(const char* says, const Parts&... parts) const {
    EXPECT_EQ(refuses(says, parts...).out, "");
  }
};

TEST_F(RecordCommand, RecordsReplaysToTheSameHashesAndCompares) {
  const json said = printed(record("one.palrec", "--json"));
  EXPECT_EQ(said["ticks"], 2001);
  EXPECT_EQ(said["lost"], 0);
  EXPECT_EQ(said["scheduling"], "virtual clock");
  EXPECT_GT(said["contact_ticks"], 200);
  EXPECT_EQ(said["bytes"], std::filesystem::file_size(in("one.palrec")));

  EXPECT_THAT(
      succeeds("compare", kSmallWaves, "--path @/one.palrec --passes 1 --out @/again --renderers auto").out,
      HasSubstr("the same hash"));
  const json segments = document("again/segments.json");
  EXPECT_EQ(segments["schema"], "palpate-segments/1");
  ASSERT_GE(segments["segments"].size(), 1u);
  for (const json& segment : segments["segments"]) EXPECT_TRUE(segment["same"]) << segment;
  // On another scene it says that hashes may differ, and is no failure.
  const ProcessOutcome other = succeeds(
      "compare sinusoid:points=961:extent_mm=40:wavelength_mm=20:amplitude_mm=1 --path @/one.palrec "
      "--passes 1 --out @/other --renderers auto");
  EXPECT_THAT(other.out, HasSubstr("the scene is another one"));

  succeeds("compare", kSmallWaves,
           "--renderers cloud,cloud:refine=1:label=bare --path @/one.palrec --passes 1 --out @/compared");
  const json result = document("compared/result.json");
  ASSERT_EQ(result["renderers"].size(), 2u);
  const json& one = result["renderers"][0];
  EXPECT_GT(one[one["accuracy"]["contact_frames"].is_null() ? "frame" : "accuracy"]["contact_frames"], 200);
}

TEST_F(RecordCommand, ExportsWhatReadsBackToTheSameBits) {
  succeeds(record("one.palrec"));
  // What is in it.
  std::vector<render::Frame> frames;
  std::vector<Vec3> hips, sent;
  auto recording = value_of(device::Recording::open(in("one.palrec")));
  device::RecordedTick tick;
  trace::ForceTrace truth;
  for (;;) {
    const Result<bool> more = recording.next(tick);
    ASSERT_TRUE(more) << more.error().message();
    if (!*more) break;
    ASSERT_TRUE(tick.tracks[0].stepped);
    truth.frames.push_back(tick.tracks[0].frame);
    hips.push_back(tick.hip_mm);
    sent.push_back(tick.sent_n);
  }
  succeeds("report export @/one.palrec --out @/one.csv");
  const auto csv = value_of(trace::read_trace_csv(in("one.csv")));
  EXPECT_EQ(trace::trace_hash(csv.trace), trace::trace_hash(truth));
  ASSERT_EQ(csv.path.size(), hips.size());
  for (std::size_t i = 0; i < hips.size(); ++i) ASSERT_EQ(csv.path.hip_mm[i], hips[i]) << i;

  succeeds("report export @/one.palrec --format motion-bids --subject 07 --task feel --out @/dataset");
  const std::string stem = "dataset/sub-07/motion/sub-07_task-feel_tracksys-haptic";
  EXPECT_EQ(document("dataset/dataset_description.json")["BIDSVersion"], "1.9.0");
  const json motion = document(stem + "_motion.json");
  EXPECT_EQ(motion["SamplingFrequency"], 1000.0);
  EXPECT_EQ(motion["TaskName"], "feel");
  std::istringstream channels(text_in(stem + "_channels.tsv"));
  std::string line;
  std::getline(channels, line);
  EXPECT_TRUE(line.starts_with("name\tcomponent\ttype\ttracked_point\tunits\t")) << line;
  int columns = 0;
  while (std::getline(channels, line)) ++columns;
  EXPECT_EQ(motion["MotionChannelCount"], columns);
  std::istringstream rows(text_in(stem + "_motion.tsv"));
  std::size_t row = 0;
  for (; std::getline(rows, line); ++row) {
    ASSERT_EQ(std::count(line.begin(), line.end(), '\t') + 1, columns) << row;
    std::istringstream fields(line);
    double latency = 0.0;
    Vec3 hip_mm;
    fields >> latency >> hip_mm.x() >> hip_mm.y() >> hip_mm.z();
    ASSERT_EQ(hip_mm, hips[row]) << row;
  }
  EXPECT_EQ(row, hips.size());

#ifdef PALPATE_WITH_HDF5
  succeeds("report export @/one.palrec --format hdf5 --out @/one.h5");
  const hid_t file = H5Fopen(in("one.h5").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  ASSERT_GE(file, 0);
  const auto vectors = [&](const char* name) {
    const hid_t data = H5Dopen2(file, name, H5P_DEFAULT);
    EXPECT_GE(data, 0) << name;
    std::vector<double> values(3 * hips.size());
    const hid_t space = H5Dget_space(data);
    EXPECT_EQ(static_cast<std::size_t>(H5Sget_simple_extent_npoints(space)), values.size()) << name;
    EXPECT_GE(H5Dread(data, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0) << name;
    H5Sclose(space);
    H5Dclose(data);
    return values;
  };
  const auto h5_hips = vectors("hip_mm"), h5_sent = vectors("sent_n"),
             h5_force = vectors("renderer_0/force_n"), h5_god = vectors("renderer_0/god_object_mm");
  for (std::size_t i = 0; i < hips.size(); ++i)
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<Eigen::Index>(axis);
      ASSERT_EQ(h5_hips[3 * i + axis], hips[i][a]) << i;
      ASSERT_EQ(h5_sent[3 * i + axis], sent[i][a]) << i;
      ASSERT_EQ(h5_force[3 * i + axis], truth.frames[i].force_n[a]) << i;
      ASSERT_EQ(h5_god[3 * i + axis], truth.frames[i].god_object_mm[a]) << i;
    }
  H5Fclose(file);
#endif
}

TEST_F(RecordCommand, InfoSaysWhatIsInIt) {
  succeeds(record("one.palrec"));
  const json facts = printed("info @/one.palrec --json");
  EXPECT_EQ(facts["recording"], in("one.palrec"));
  EXPECT_EQ(facts["bytes"], std::filesystem::file_size(in("one.palrec")));
  EXPECT_NEAR(facts["length_s"].get<double>(), 2.0, 1e-9);
  EXPECT_EQ(facts["lost_ticks"], 0);
  EXPECT_EQ(facts["scene"], kSmallWaves);
  EXPECT_EQ(facts["segments"], 1);
  EXPECT_TRUE(facts["faults"].empty() && facts["warnings"].empty());
  EXPECT_TRUE(facts["closed"].get<bool>());
  EXPECT_GT(facts["device"]["force_max_n"], 0.0);
  ASSERT_EQ(facts["renderers"].size(), 1u);
  EXPECT_EQ(facts["renderers"][0]["name"], "cloud");
  EXPECT_EQ(facts["renderers"][0]["ticks"], 2001);
  EXPECT_GT(facts["renderers"][0]["contact_ticks"], 200);
  EXPECT_TRUE(facts["renderers"][0]["options"].contains("refine"));
  const ProcessOutcome text = succeeds("info @/one.palrec");
  for (const char* const words : {"2.000 s, 2,001 ticks, none lost", "virtual clock", kSmallWaves,
                                  "cloud (cloud): stepped in 2,001 ticks"})
    EXPECT_THAT(text.out, HasSubstr(words)) << words << "\n";
  // Whatever it is called.
  std::filesystem::copy_file(in("one.palrec"), in("renamed.bin"));
  const ProcessOutcome renamed = palpate("info @/renamed.bin");
  EXPECT_THAT(renamed.out, HasSubstr("2,001 ticks")) << renamed.err;
}

TEST_F(RecordCommand, WhatIsTornIsReadAndWhatIsDamagedOnlyWhereAsked) {
  succeeds(record("one.palrec"));
  std::filesystem::copy_file(in("one.palrec"), in("torn.palrec"));
  std::filesystem::resize_file(in("torn.palrec"), std::filesystem::file_size(in("one.palrec")) / 2);
  const json facts = printed("info @/torn.palrec --json");
  EXPECT_TRUE(facts["ticks"] < 2001 && facts["ticks"] > 500) << facts["ticks"];
  EXPECT_FALSE(facts["closed"].get<bool>());
  EXPECT_TRUE(facts["reason"].is_null());
  EXPECT_GE(facts["warnings"].size(), 1u);
  EXPECT_THAT(succeeds("report export @/torn.palrec --out @/torn.csv").err,
              HasAll("not closed", "half a chunk"));
  const ProcessOutcome replayed =
      succeeds("compare", kSmallWaves, "--path @/torn.palrec --passes 1 --out @/again --renderers auto");
  EXPECT_THAT(replayed.out, HasSubstr("the same hash"));
  EXPECT_THAT(replayed.err, HasSubstr("not closed"));
  damage(in("one.palrec"));
  refused("--skip-damaged", "info @/one.palrec");
  EXPECT_THAT(succeeds("info @/one.palrec --skip-damaged").out, HasSubstr("damaged and were left out"));
  refuses({"byte ", "--skip-damaged"}, "report export @/one.palrec --out @/one.csv");
  EXPECT_FALSE(exists("one.csv"));
  EXPECT_THAT(succeeds("report export @/one.palrec --skip-damaged --out @/one.csv").err,
              HasSubstr("damaged"));
}

TEST_F(RecordCommand, BadArgumentsNameTheirRemedy) {
  refused("palrec", record("no-ending"));
  refused("create the folder", record("no/such/folder.palrec"));
  refused("sim:omni", record("x.palrec", "--device sim:omny"));
  refused("hand", record("x.palrec", "--grip foot"));
  refused("one renderer", "live record", kSmallWaves,
          "--renderer cloud,cloud-smooth --seconds 1 --accelerated --out @/x.palrec");
  EXPECT_FALSE(exists("x.palrec"));
  write_text(in("there.palrec"), "somebody's");
  refused("--force", record("there.palrec"));
  EXPECT_EQ(text_in("there.palrec"), "somebody's");
  refused("is no recording", "report export @/there.palrec --out @/x.csv");
  refused("no such file", "report export @/missing.palrec --out @/x.csv");
  refused("is no recording", "info @/there.palrec");
  refused("no such file", "info @/missing.palrec");
  refused("--skip-damaged does nothing", "info", kSmallWaves, "--skip-damaged");
  succeeds(record("one.palrec"));
  refused("--unit does nothing", "info @/one.palrec --unit m");
  refused(".csv", "report export @/one.palrec --out @/x.txt");
  refused("cloud", "report export @/one.palrec --renderer bare --out @/x.csv");
  refused("--out", "report export @/one.palrec");
  std::filesystem::create_directories(in("full"));
  write_text(in("full/kept.txt"), "kept");
  refused("not empty", "report export @/one.palrec --format motion-bids --out @/full");
  EXPECT_FALSE(exists("x.csv"));
}

TEST_F(RecordCommand, StoppedByCtrlCItIsClosedAndWhole) {
  Started started(folder_, words("live record", kSmallWaves,
                                 "--renderer cloud --seconds 60 --path weave:frames=2000:depth_mm=1 --out "
                                 "@/stopped.palrec"));
  started.wait_for([&] {
    std::error_code code;
    const auto bytes = std::filesystem::file_size(in("stopped.palrec"), code);
    constexpr std::uintmax_t kSomeChunks = 50'000;
    return !code && bytes > kSomeChunks;
  });
  started.send(SIGINT);
  EXPECT_EQ(started.end(), 128 + SIGINT) << started.err();
  EXPECT_THAT(started.err(), HasSubstr("stopped.palrec holds"));
  auto recording = value_of(device::Recording::open(in("stopped.palrec")));
  device::RecordedTick tick;
  std::uint64_t ticks = 0;
  Result<bool> more = recording.next(tick);
  for (; more && *more; more = recording.next(tick)) ++ticks;
  ASSERT_TRUE(more) << more.error().message();
  EXPECT_GT(ticks, 200u);
  EXPECT_TRUE(recording.end().closed);
  EXPECT_EQ(recording.end().reason, "stopped");
  ASSERT_FALSE(recording.notes().empty());
  EXPECT_THAT(recording.notes().front(), HasSubstr("scheduling: "));
}

}  // namespace
}  // namespace palpate::experiments
