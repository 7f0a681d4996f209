// What the public headers show first, compiled: no source root is on the include path here, so nothing inside
// leaks.
#include <algorithm>
#include <array>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include <palpate/accuracy.h>
#include <palpate/analytic_surface.h>
#include <palpate/baselines.h>
#include <palpate/cleaning.h>
#include <palpate/clock.h>
#include <palpate/cloud.h>
#include <palpate/control.h>
#include <palpate/decision.h>
#include <palpate/device/contact_catch_up.h>
#include <palpate/device/device.h>
#include <palpate/device/device_map.h>
#include <palpate/device/drivers.h>
#include <palpate/device/force_governor.h>
#include <palpate/device/guard.h>
#include <palpate/device/heartbeat.h>
#include <palpate/device/link.h>
#include <palpate/device/loop_histogram.h>
#include <palpate/device/scheduling.h>
#include <palpate/device/servo.h>
#include <palpate/device/servo_loop.h>
#include <palpate/device/servo_thread.h>
#include <palpate/device/watchdog.h>
#include <palpate/generate.h>
#include <palpate/geometry.h>
#include <palpate/interval.h>
#include <palpate/model_store.h>
#include <palpate/motion.h>
#include <palpate/options.h>
#include <palpate/paths.h>
#include <palpate/progress.h>
#include <palpate/read_model.h>
#include <palpate/reference.h>
#include <palpate/registry.h>
#include <palpate/renderer.h>
#include <palpate/replay.h>
#include <palpate/result.h>
#include <palpate/scene.h>
#include <palpate/surface.h>
#include <palpate/trace.h>
#include <palpate/triple_buffer.h>
#include <palpate/vec.h>
#include <palpate/write_mesh.h>

namespace palpate::example {

int failed(const Error& error);
Result<double> half_of(double x);
Status prepare_all();
struct FakeThread {
  const device::LoopHistograms& histograms() const;
};
struct Fresh {
  bool zero() const;
};
void save();
void send(const Vec3& force_n);
void take(std::uint8_t byte);
bool going_on();
double next_tick_s();

void show_aabb(const cloud::Cloud& cloud) {
  palpate::geometry::Aabb box;
  for (std::size_t i = 0; i < cloud.size(); ++i) box.add(cloud.point_mm(i));
  const Vec3 above_mm = box.centre_mm() + Vec3(0.0, 0.0, box.extent_mm().z());
}

int show_accuracy(render::SceneInput& scene, const trace::ProbePath& path, trace::ReplayReport& replayed,
                  const trace::ReferenceTrace& truth) {
  const auto& model = scene.models[0];
  const palpate::metrics::AnalyticTruth surface(*model.analytic, model.world_from_model);
  auto scored = palpate::metrics::score(path, replayed.trace, truth, &surface, {});
  if (!scored) return failed(scored.error());
  std::printf("RMS error %g N\n", scored->force_rms_n.value_or(0.0));
  return 0;
}

void show_analytic_surface() {
  const auto model = palpate::cloud::generate({"sphere", {}});
  const geometry::AnalyticSurface& sphere = *model->surface;
  const geometry::SurfacePoint top = sphere.closest({0.0, 0.0, 100.0});
  const double depth_mm = -sphere.signed_distance_mm(top.point_mm - 2.0 * top.normal);  // 2
}

void show_at_stop() {
  palpate::StopCallback on_stop([&] {
    save();
    return std::string("session.rec is kept");
  });
  // .. in the thread that waits for SIGINT, and ends the program next:
  std::fprintf(stderr, "%s\n", palpate::run_stop_callbacks().c_str());
}

void show_baselines() {
  palpate::render::Registry registry;
  palpate::render::register_toolkit_renderers(registry);
  palpate::baselines::register_baseline_renderers(registry);
  auto rival = registry.make("mesh-godobject", {});
}

void show_cleaning(const cloud::Cloud& cloud) {
  palpate::scene::Cleaning cleaning;
  palpate::baselines::register_cleaning(cleaning);
  auto steps = cleaning.parse("outliers/distance=3+smooth");
  auto clean = cleaning.run(cloud, *steps, 0, palpate::no_progress());
}

void show_clock(render::HapticRenderer* renderer, const Vec3& hip_mm) {
  palpate::MonotonicClock clock;  // VirtualClock in tests: it moves only when told to
  const palpate::Stopwatch watch;
  const render::Frame frame = renderer->step(hip_mm, clock.now_s());
  std::printf("%g ms, contact %d\n", watch.ms(), frame.contact);
}

int show_cloud(render::SceneInput& scene) {
  const std::vector<Vec3> points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  auto built = palpate::cloud::build_cloud(points, palpate::cloud::NonFinite::kDrop);
  if (!built) return failed(built.error());
  scene.models[0].cloud = std::make_shared<const palpate::cloud::Cloud>(*std::move(built));
  return 0;
}

void show_control(std::unique_ptr<render::HapticRenderer> inner) {
  palpate::control::ControlOptions control;
  control.coupling = palpate::control::Coupling{1.0, 0.001};
  auto renderer = palpate::control::wrap(std::move(inner), control);  // a renderer as any other
}

int show_decision(render::HapticRenderer* renderer, render::SceneInput& scene) {
  const auto decided = renderer->decide(scene, {});  // what would be built, and why
  if (!decided) return failed(decided.error());
  for (const auto& d : decided->models[0].decisions) std::puts(palpate::render::note_text(d).c_str());
  return 0;
}

void show_device_bring_up(render::HapticRenderer* renderer, const Vec3& hip_mm, const MonotonicClock& clock,
                          const Vec3& free_mm) {
  palpate::render::ContactCatchUp catch_up;  // for a loop of your own; Servo has one
  catch_up.begin(*renderer, free_mm, clock.now_s());
  while (catch_up.pending()) (void)catch_up.advance(*renderer, hip_mm, next_tick_s());
}

int show_device_device(Vec3& target_mm, device::Device& device) {
  auto opened = device.open();  // zero force commanded
  if (!opened) return failed(opened.error());
  const palpate::device::DeviceState state = device.read();
  if (state.status == palpate::device::ReadStatus::kFresh) target_mm = state.position_mm;
  device.close();
  return 0;
}

void show_device_device_map(const device::DeviceState& state) {
  palpate::geometry::RigidTransform world_from_device;
  world_from_device.translation_mm = {0.0, 0.0, 40.0};
  const palpate::device::DeviceMap map(world_from_device, 2.0);  // a mm of the device is 2 mm of the scene
  const Vec3 hip = map.world_mm(state.position_mm);
}

void show_device_drivers() {
  palpate::device::Drivers drivers;
  palpate::device::register_all_drivers(drivers);
  for (const auto& driver : drivers.all())
    for (const auto& entry : driver.look()) std::puts(entry.what.c_str());
}

int show_device_force_governor(device::Device& device, const MonotonicClock& clock,
                               const render::Frame& frame) {
  auto made = palpate::device::ForceGovernor::create(device.limits(), {.user_limit_n = 1.0});
  if (!made) return failed(made.error());
  made->arm(clock.now_s());
  device.send(made->govern(clock.now_s(), device.read(), frame.force_n));
  return 0;
}

int show_device_guard(device::Servo& servo, const Fresh& fresh) {
  auto guard = palpate::device::Guard::start([&] { return fresh.zero(); });  // first of all: it forks
  if (!guard) return failed(guard.error());
  servo.watched_by(&guard->heartbeat());
  return 0;
}

void show_device_heartbeat(device::Device& device, device::Servo& servo) {
  palpate::device::Heartbeat heart;
  servo.watched_by(&heart);
  palpate::device::Watchdog watchdog(device, heart);
}

void show_device_link(device::Link& link) {
  std::array<std::uint8_t, 64> bytes;
  const palpate::device::Polled came = link.poll(bytes);
  if (came.gone) return;
  for (std::size_t i = 0; i < came.size; ++i) take(bytes[i]);
}

void show_device_loop_histogram(FakeThread& thread) {
  const palpate::device::LoopStatistics loop = thread.histograms().statistics();  // while it runs too
  std::printf("late by %lld ns at most\n", static_cast<long long>(loop.lateness.max_ns));
}

void show_device_scheduling() {
  palpate::device::SchedulingMode mode;
  const palpate::device::ProcessRealTime held({.lock_memory = true}, mode);  // while it lives
  for (const auto& missing : mode.not_obtained) std::puts(missing.c_str());
}

int show_device_servo(render::HapticRenderer* renderer, device::Device& device, const MonotonicClock& clock) {
  palpate::device::Servo servo(*renderer, {.user_limit_n = 1.0}, device, clock, {});
  if (auto started = servo.start(); !started) return failed(started.error());
  while (going_on()) {  // each millisecond: see servo_thread.h
    if (servo.tick().fault != palpate::device::Fault::kNone) servo.rearm();
  }
  return 0;
}

int show_device_servo_loop(const MonotonicClock& clock, device::Servo& servo, VirtualClock& virtual_clock) {
  auto loop = palpate::device::ServoLoop::create(servo, clock, 1000);
  if (!loop) return failed(loop.error());
  const auto ticks =
      palpate::device::run_accelerated(**loop, virtual_clock, 60'000'000'000, [] { return true; });
  return 0;
}

int show_device_servo_thread(const MonotonicClock& clock, device::Servo& servo) {
  auto thread = palpate::device::ServoThread::create(servo, clock, {});
  if (!thread) return failed(thread.error());
  if (auto started = (*thread)->start(); !started) return failed(started.error());
  // .. until the user has had enough:
  (*thread)->stop();  // zero force, device closed
  return 0;
}

int show_device_watchdog(device::Device& device, device::Servo& servo) {
  palpate::device::Heartbeat heart;
  servo.watched_by(&heart);
  palpate::device::Watchdog watchdog(device, heart);
  if (auto started = watchdog.start(); !started) return failed(started.error());
  return 0;
}

int show_generate(render::SceneInput& scene) {
  const auto spec = palpate::parse_named_options("sinusoid:points=10201");
  auto model = palpate::cloud::generate(*spec);
  if (!model) return failed(model.error());
  scene.models[0].analytic = model->surface;
  scene.models[0].cloud = std::make_shared<const palpate::cloud::Cloud>(std::move(model->cloud));
  return 0;
}

void show_triple_buffer(Vec3& target_mm) {
  palpate::TripleBuffer<Vec3> hip{Vec3(Vec3::Zero())};  // one thread writes, one reads, nobody waits
  hip.publish(Vec3(0.0, 0.0, 1.0));                     // window
  if (hip.acquire()) target_mm = hip.front();           // servo
}

void show_interval(metrics::Accuracy& accuracy) {
  if (const auto& in = accuracy.force_rms_percent_interval)
    std::printf("95 %% between %.2f and %.2f %%\n", in->low, in->high);
}

void show_memory_limit(io::Readers& readers) {
  io::ReadOptions options;
  options.max_bytes = 2 * palpate::kMemoryLimitBytes;  // a scan of 200 million points
  auto model = readers.read("scan.ply", options);
}

void show_model_store(render::Registry& registry, render::SceneInput& scene) {
  palpate::render::ModelStore store;  // points, neighbours, meshes: once for all renderers
  for (const char* name : {"cloud", "cloud-literal"}) {
    auto renderer = registry.make(name, {});
    auto report = (*renderer)->prepare(scene, {.store = &store});
  }
}

void show_motion(render::SceneInput& scene) {
  auto simulation = std::make_shared<palpate::render::ScriptedSimulation>();
  palpate::render::ScriptedMotion slide;
  slide.velocity_mm_s = {10.0, 0.0, 0.0};
  scene.models[0].motion = simulation->add(slide);
  scene.simulation = simulation;  // and before each frame: simulation->advance(t_s)
}

int show_options(render::Registry& registry) {
  const auto spec = palpate::parse_named_options("cloud:shading=none");
  if (!spec) return failed(spec.error());
  auto renderer = registry.make(spec->name, spec->options);
  return 0;
}

int show_paths(render::SceneInput& scene) {
  palpate::paths::PathTarget target;
  target.surface = scene.models[0].analytic.get();
  target.box_mm = scene.models[0].cloud->box_mm();
  auto path = palpate::paths::make_path({"weave", {}}, target);
  if (!path) return failed(path.error());
  return 0;
}

void show_progress(render::HapticRenderer* renderer, render::SceneInput& scene) {
  struct Dots final : palpate::Progress {
    void report(std::string_view what, double) override { std::puts(std::string(what).c_str()); }
  } dots;
  auto report = renderer->prepare(scene, {.progress = &dots});
}

int show_read_model(render::SceneInput& scene) {
  palpate::io::Readers readers;
  palpate::io::add_standard_readers(readers);
  palpate::io::ReadOptions options;
  options.unit = palpate::io::Unit::kMetre;
  auto model = readers.read("dragon_vrip.ply.gz", options);
  if (!model) return failed(model.error());
  scene.models[0].cloud = std::make_shared<const palpate::cloud::Cloud>(std::move(model->cloud));
  return 0;
}

int show_reference(render::SceneInput& scene, const trace::ProbePath& path) {
  const auto& m = scene.models[0];
  auto truth = palpate::metrics::analytic_reference(*m.analytic, path, m.surface.stiffness_n_per_mm,
                                                    scene.force_limit_n, m.world_from_model);
  if (!truth) return failed(truth.error());
  std::puts(truth->exactness.c_str());
  return 0;
}

int show_registry() {
  palpate::render::Registry registry;
  palpate::render::register_toolkit_renderers(registry);
  auto renderer = registry.make("cloud", {});
  if (!renderer) return failed(renderer.error());  // names the nearest known ones
  return 0;
}

int show_renderer(render::HapticRenderer* renderer, render::SceneInput& scene) {
  if (auto report = renderer->prepare(scene, {}); !report) return failed(report.error());
  renderer->restart({0.0, 0.0, 60.0}, 0.0);                                     // in free space
  const palpate::render::Frame frame = renderer->step({0.0, 0.0, 39.0}, 1e-3);  // each millisecond
  if (frame.contact) send(frame.force_n);
  return 0;
}

int show_replay(render::HapticRenderer* renderer, const trace::ProbePath& path) {
  auto replayed = palpate::trace::measure(*renderer, path, {});
  if (!replayed) return failed(replayed.error());
  std::printf("%s, mean %g us\n", replayed->trace_hash.c_str(), replayed->contact->mean_us.value_or(0.0));
  return 0;
}

Status show_result() {
  if (auto half = half_of(3.0))  // a value, or what was wrong
    std::printf("%g\n", *half);
  else
    std::fprintf(stderr, "%s\n", half.error().message().c_str());
  PALPATE_TRY(prepare_all());  // or hand the Error on
  return Done{};
}

void show_rigid_transform() {
  palpate::geometry::RigidTransform world_from_model;
  world_from_model.translation_mm = {0.0, 0.0, 50.0};
  const Vec3 in_world_mm = world_from_model * Vec3(1.0, 2.0, 3.0);
  const Vec3 back_mm = world_from_model.inverse() * in_world_mm;
}

int show_scene(io::Readers& readers) {
  auto file = palpate::scene::open_scene("dragon.toml");
  if (!file) return failed(file.error());  // file, line, remedy
  auto loaded = palpate::scene::load(*file, readers, {}, palpate::no_progress());
  if (!loaded) return failed(loaded.error());
  const palpate::render::SceneInput& scene = loaded->input;
  return 0;
}

void show_surface(render::SceneInput& scene) {
  palpate::surface::Surface rubber;
  rubber.stiffness_n_per_mm = 0.3;
  rubber.friction = {0.7, 0.5};  // static, dynamic
  scene.models[0].surface = rubber;
}

int show_trace() {
  auto path = palpate::trace::read_path_csv("probe.csv");
  if (!path) return failed(path.error());  // with its line
  path->t_s.push_back(path->t_s.back() + 1e-3);
  path->hip_mm.push_back({0.0, 0.0, 39.0});
  auto wrote = palpate::trace::write_path_csv(*path, "longer.csv");
  return 0;
}

int show_triangle_mesh() {
  palpate::geometry::TriangleMesh mesh;
  mesh.vertices_mm = {{0, 0, 0}, {10, 0, 0}, {0, 10, 0}};
  mesh.triangles = {{0, 1, 2}};  // counter-clockwise from outside
  if (auto wrote = io::write_mesh_ply("facet.ply", mesh); !wrote) return failed(wrote.error());
  return 0;
}

void show_vec() {
  const palpate::Vec3 hip_mm(0.0, 0.0, 12.5);
  if (!palpate::is_finite(hip_mm)) return;
  const double from_origin_mm = hip_mm.norm();
}

int show_write_mesh(const cloud::Cloud& cloud) {
  if (auto wrote = palpate::io::write_cloud("felt.ply", cloud); !wrote) return failed(wrote.error());
  return 0;
}

}  // namespace palpate::example
