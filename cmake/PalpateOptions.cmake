# Options, compiler settings and the one function that declares a module.
include(GNUInstallDirs)

option(PALPATE_BUILD_BASELINES "Mesh and literature rivals (CGAL, Embree, OpenMesh, PCL)" ${PROJECT_IS_TOP_LEVEL})
option(PALPATE_BUILD_EXPERIMENTS "The palpate command (needs the baselines)" ${PROJECT_IS_TOP_LEVEL})
option(PALPATE_BUILD_TESTS "Tests" ${PROJECT_IS_TOP_LEVEL})
option(PALPATE_BUILD_BENCHMARKS "Programs that measure, behind tests and pages" ${PROJECT_IS_TOP_LEVEL})
option(PALPATE_WITH_PCD "PCD files through PCL, as a target of its own" ${PROJECT_IS_TOP_LEVEL})
option(PALPATE_WITH_DEM "Height grids (GeoTIFF, SRTM, ..) through GDAL, as a target of its own" ${PROJECT_IS_TOP_LEVEL})
option(PALPATE_WITH_DEVICES "Drivers of real devices (libusb, hidapi). Without: simulated ones, servo, safety, recordings" ${PROJECT_IS_TOP_LEVEL})
option(PALPATE_WITH_HDF5 "Recordings exported as HDF5" ${PROJECT_IS_TOP_LEVEL})
option(PALPATE_WITH_WINDOW "The window of palpate live (GLFW, Dear ImGui, epoxy)" ${PROJECT_IS_TOP_LEVEL})
option(PALPATE_WITH_PYTHON "The Python module palpate, where Python, numpy and pybind11 are found" ${PROJECT_IS_TOP_LEVEL})
option(PALPATE_WITH_VORONOI "Voronoi neighbours through CGAL, as a target of its own" ${PROJECT_IS_TOP_LEVEL})
option(PALPATE_UNITY "Several source files of a target compile as one: half the time from nothing. Off in the preset dev" OFF)
option(PALPATE_BUILD_FUZZERS "libFuzzer targets (clang only)" OFF)
option(PALPATE_WARNINGS_AS_ERRORS "Treat warnings as errors" OFF)
set(PALPATE_SANITIZE "" CACHE STRING "Sanitizers: empty, address, thread")

if(PALPATE_BUILD_EXPERIMENTS AND NOT PALPATE_BUILD_BASELINES)
  message(FATAL_ERROR "PALPATE_BUILD_EXPERIMENTS needs PALPATE_BUILD_BASELINES=ON")
endif()
if(PALPATE_BUILD_EXPERIMENTS AND NOT PALPATE_WITH_DEVICES)
  message(FATAL_ERROR "PALPATE_BUILD_EXPERIMENTS needs PALPATE_WITH_DEVICES=ON: palpate live drives them")
endif()
if(PALPATE_BUILD_BASELINES AND NOT PALPATE_WITH_VORONOI)
  message(FATAL_ERROR "PALPATE_BUILD_BASELINES needs PALPATE_WITH_VORONOI=ON: vgraph walks its graph")
endif()

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
if(PROJECT_IS_TOP_LEVEL)
  set(CMAKE_RUNTIME_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/bin")
  # Modules that programs load themselves, found by the run path.
  set(PALPATE_MODULE_FOLDER "${CMAKE_BINARY_DIR}/lib/palpate")
  set(CMAKE_BUILD_RPATH "${PALPATE_MODULE_FOLDER}")
  if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
    set(CMAKE_BUILD_TYPE Release CACHE STRING "" FORCE)
  endif()
endif()

find_program(PALPATE_CCACHE ccache)
if(PALPATE_CCACHE AND PROJECT_IS_TOP_LEVEL AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  # Fresh clones in other folders hit the cache only with these two settings.
  set(CMAKE_CXX_COMPILER_LAUNCHER
      ${CMAKE_COMMAND} -E env CCACHE_BASEDIR=${CMAKE_SOURCE_DIR} CCACHE_NOHASHDIR=1 ${PALPATE_CCACHE})
endif()

# Flags every target of ours gets. -ffp-contract=off keeps a multiply and an add two rounded operations, so
# that a trace has one hash whatever the optimiser; fast-math is never used.
add_library(palpate_build_flags INTERFACE)
target_compile_options(palpate_build_flags INTERFACE
  -ffp-contract=off -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion -Wnon-virtual-dtor
  -Wold-style-cast -Wcast-qual -Woverloaded-virtual -Wdouble-promotion)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_GREATER_EQUAL 12
    AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 14)
  # A false positive on "literal" + std::string at -O3: gcc bug 105651, mended in gcc 13.3 and 14.
  target_compile_options(palpate_build_flags INTERFACE -Wno-restrict)
endif()
# It asks whether a type of an anonymous namespace is in the file that is compiled; there that file only includes.
target_compile_options(palpate_build_flags INTERFACE
  $<$<AND:$<CXX_COMPILER_ID:GNU>,$<BOOL:$<TARGET_PROPERTY:UNITY_BUILD>>>:-Wno-subobject-linkage>)
# What renders a frame and ships compiles file by file: the inliner's limits are those of a unit, and in units of eight
# files a frame of `cloud` took 1.6 % more instructions, one of `cloud-literal` 26 %.
set(palpate_frames_in_units ${PALPATE_UNITY})
if(CMAKE_BUILD_TYPE STREQUAL "Release")
  set(palpate_frames_in_units OFF)
endif()
if(PALPATE_WARNINGS_AS_ERRORS AND PROJECT_IS_TOP_LEVEL)
  target_compile_options(palpate_build_flags INTERFACE -Werror)
endif()
if(PALPATE_SANITIZE STREQUAL "address")
  add_compile_options(-fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer)
  add_link_options(-fsanitize=address,undefined)
elseif(PALPATE_SANITIZE STREQUAL "thread")
  add_compile_options(-fsanitize=thread -fno-omit-frame-pointer)
  add_link_options(-fsanitize=thread)
  add_compile_definitions(PALPATE_STD_THREADS=1)  # see toolkit/core/parallel.h
endif()

# Where include lines of ours begin, for targets that link no module: <palpate/x.h> in one of the last three.
set(palpate_include_roots "${PROJECT_SOURCE_DIR}" "${PROJECT_SOURCE_DIR}/toolkit/include"
  "${PROJECT_SOURCE_DIR}/baselines/include" "${PROJECT_SOURCE_DIR}/device/include")

# palpate_module(NAME [FRAMES] [SOURCES ...] [PUBLIC ...] [PRIVATE ...])
# One static library palpate_NAME (alias palpate::NAME) in the current folder. PUBLIC and PRIVATE are the
# modules and libraries it links: the real dependency edges. Without SOURCES the module is header-only. FRAMES: its code
# runs in renderers' frames, or prepares them.
function(palpate_module name)
  cmake_parse_arguments(arg "FRAMES" "" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
  set(target palpate_${name})
  if(arg_SOURCES)
    add_library(${target} STATIC ${arg_SOURCES})
    set(scope PUBLIC)
    target_link_libraries(${target} PRIVATE $<BUILD_INTERFACE:palpate_build_flags> ${arg_PRIVATE})
    # Eight at once: reading headers is most of the work, and a module still gives both cores something to do.
    set(in_units ${PALPATE_UNITY})
    if(arg_FRAMES)
      set(in_units ${palpate_frames_in_units})
    endif()
    set_target_properties(${target} PROPERTIES UNITY_BUILD ${in_units} UNITY_BUILD_BATCH_SIZE 8)
  else()
    add_library(${target} INTERFACE)
    set(scope INTERFACE)
  endif()
  add_library(palpate::${name} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${name})
  target_compile_features(${target} ${scope} cxx_std_20)
  file(RELATIVE_PATH top "${PROJECT_SOURCE_DIR}" "${CMAKE_CURRENT_SOURCE_DIR}")
  string(REGEX REPLACE "/.*" "" top "${top}")
  set(public_roots toolkit)
  if(top MATCHES "^(baselines|device)$")
    list(APPEND public_roots ${top})
  endif()
  list(TRANSFORM public_roots REPLACE "(.+)" "$<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/\\1/include>")
  target_include_directories(${target} ${scope} $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}> ${public_roots}
    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  target_link_libraries(${target} ${scope} ${arg_PUBLIC})
  set_property(GLOBAL APPEND PROPERTY PALPATE_MODULES ${target})
endfunction()

# palpate_uses_cgal(NAME SOURCE ...)
# Gives module NAME CGAL's headers and number libraries, and the rounding mode that its filtered predicates need to the
# sources that include it. Not CGAL's own targets: they pass -frounding-math on to everything that links them.
set(CGAL_DO_NOT_WARN_ABOUT_CMAKE_BUILD_TYPE TRUE)
function(palpate_uses_cgal name)
  find_package(CGAL REQUIRED)
  find_library(PALPATE_GMP gmp REQUIRED)
  find_library(PALPATE_MPFR mpfr REQUIRED)
  target_include_directories(palpate_${name} SYSTEM PRIVATE ${CGAL_INCLUDE_DIRS})
  target_link_libraries(palpate_${name} PRIVATE ${PALPATE_GMP} ${PALPATE_MPFR})
  set_source_files_properties(${ARGN} PROPERTIES COMPILE_OPTIONS "-frounding-math")
endfunction()
