# Installation: libraries, headers, the palpate command, and the package files for find_package(palpate).
#
# One export set per component, so that who links the toolkit needs neither PCL nor CGAL:
#   toolkit (always), scene, device, pcd, voronoi, dem, baselines.   See docs/how-to/change-palpate.md.
include(CMakePackageConfigHelpers)

set(palpate_package_dir "${CMAKE_INSTALL_LIBDIR}/cmake/palpate")

# The component a module belongs to follows from its folder.
function(palpate_component_of target out)
  get_target_property(folder ${target} SOURCE_DIR)
  file(RELATIVE_PATH folder "${PROJECT_SOURCE_DIR}" "${folder}")
  if(folder MATCHES "^toolkit/(pcd|dem|scene|stream|voronoi)")
    set(${out} ${CMAKE_MATCH_1} PARENT_SCOPE)
  elseif(folder MATCHES "^(toolkit|device|baselines)(/|$)")
    set(${out} ${CMAKE_MATCH_1} PARENT_SCOPE)
  else()
    set(${out} "" PARENT_SCOPE)  # experiments and tests: nothing to link
  endif()
endfunction()

set(palpate_components "")
get_property(palpate_modules GLOBAL PROPERTY PALPATE_MODULES)
foreach(module IN LISTS palpate_modules)
  palpate_component_of(${module} component)
  if(component)
    install(TARGETS ${module} EXPORT palpate_${component}_targets
      ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT dev)
    list(APPEND palpate_components ${component})
  endif()
endforeach()
list(REMOVE_DUPLICATES palpate_components)

foreach(component IN LISTS palpate_components)
  install(EXPORT palpate_${component}_targets NAMESPACE palpate:: DESTINATION ${palpate_package_dir}
    FILE palpate-${component}-targets.cmake COMPONENT dev)
endforeach()

# What an application includes, and nothing else.
foreach(folder toolkit device baselines)
  if(folder IN_LIST palpate_components)
    install(DIRECTORY "${PROJECT_SOURCE_DIR}/${folder}/include/" DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
      COMPONENT dev FILES_MATCHING PATTERN "*.h")
  endif()
endforeach()

if(TARGET palpate AND PALPATE_BUILD_EXPERIMENTS)
  install(TARGETS palpate RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT tools)
  install(FILES "${PROJECT_BINARY_DIR}/experiments/palpate.bash" COMPONENT tools
    DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions RENAME palpate)
  install(FILES "${PROJECT_BINARY_DIR}/experiments/palpate.1" DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT tools)
  install(FILES "${PROJECT_SOURCE_DIR}/experiments/window/palpate.desktop" COMPONENT tools
    DESTINATION ${CMAKE_INSTALL_DATADIR}/applications)
  set_target_properties(palpate PROPERTIES INSTALL_RPATH "$ORIGIN/../${CMAKE_INSTALL_LIBDIR}/palpate")
  if(TARGET palpate_formats)
    install(TARGETS palpate_formats LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/palpate COMPONENT tools)
  endif()
endif()

if(TARGET palpate-reconstruct)
  install(TARGETS palpate-reconstruct RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT tools)
endif()

# The site, if docs/build has made it.
install(DIRECTORY "${PROJECT_SOURCE_DIR}/build/site/" DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/palpate-doc/html
  COMPONENT doc OPTIONAL)
foreach(package tools:palpate dev:libpalpate-dev doc:palpate-doc)
  string(REPLACE ":" ";" package ${package})
  list(GET package 0 component)
  list(GET package 1 name)
  install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${name} RENAME copyright COMPONENT ${component})
endforeach()
install(FILES README.md CITATION.cff DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/palpate-doc COMPONENT doc)

# Who sits at the machine may open the devices. device/drivers/all_drivers.cpp says which.
# A component of its own, so that a test can pack it by itself.
install(FILES "${PROJECT_SOURCE_DIR}/device/drivers/70-palpate.rules" DESTINATION lib/udev/rules.d COMPONENT udev)

configure_package_config_file("${CMAKE_CURRENT_LIST_DIR}/palpateConfig.cmake.in"
  "${PROJECT_BINARY_DIR}/palpateConfig.cmake" INSTALL_DESTINATION ${palpate_package_dir})
write_basic_package_version_file("${PROJECT_BINARY_DIR}/palpateConfigVersion.cmake"
  COMPATIBILITY SameMinorVersion)
install(FILES "${PROJECT_BINARY_DIR}/palpateConfig.cmake" "${PROJECT_BINARY_DIR}/palpateConfigVersion.cmake"
  DESTINATION ${palpate_package_dir} COMPONENT dev)

# `cpack` in the build folder makes an archive of everything, and Debian packages where dpkg is there: palpate (the
# command and the rules of udev), libpalpate-dev (static libraries and headers), python3-palpate, palpate-doc. All install
# below /usr, as the system's own do.
if(PROJECT_IS_TOP_LEVEL)
  set(CPACK_PACKAGE_NAME palpate)
  set(CPACK_PACKAGE_VENDOR "Palpate")
  set(CPACK_PACKAGE_CONTACT "Palpate's authors")
  set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "${PROJECT_DESCRIPTION}")
  set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
  set(CPACK_STRIP_FILES ON)
  set(CPACK_COMPONENTS_ALL tools udev dev doc)
  find_program(PALPATE_DPKG dpkg)
  set(CPACK_GENERATOR TGZ)
  if(PALPATE_DPKG)
    list(APPEND CPACK_GENERATOR DEB)
    set(CPACK_DEB_COMPONENT_INSTALL ON)
    set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
    set(CPACK_DEBIAN_PACKAGE_SECTION science)
    set(CPACK_DEBIAN_COMMAND_PACKAGE_NAME palpate)
    set(CPACK_DEBIAN_COMMAND_PACKAGE_SHLIBDEPS ON)
    # Programs that it starts (palpate fetch, figures of reports), and what draws the window without a graphics card.
    set(CPACK_DEBIAN_COMMAND_PACKAGE_RECOMMENDS "ca-certificates, curl, gnuplot-nox | gnuplot, libgl1-mesa-dri")
    # The daemon reads the rules again, and devices that are plugged in already get them.
    set(CPACK_DEBIAN_COMMAND_PACKAGE_CONTROL_EXTRA "${PROJECT_SOURCE_DIR}/device/drivers/package/postinst")
    set(CPACK_DEBIAN_DEV_PACKAGE_NAME libpalpate-dev)
    set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
    # What find_package(palpate) always asks for; components that bring more find it among what is recommended.
    set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS
      "libeigen3-dev, libtbb-dev, libfmt-dev, zlib1g-dev, liblzma-dev, libzstd-dev, libpugixml-dev, nettle-dev")
    file(STRINGS "${PROJECT_SOURCE_DIR}/cmake/packages.txt" recommended REGEX "^[a-z0-9.+-]+-dev +run ")
    list(TRANSFORM recommended REPLACE " .*" "")
    list(JOIN recommended ", " CPACK_DEBIAN_DEV_PACKAGE_RECOMMENDS)
    set(CPACK_DEBIAN_DOC_PACKAGE_NAME palpate-doc)
    set(CPACK_DEBIAN_DOC_PACKAGE_SECTION doc)
    set(CPACK_DEBIAN_DOC_PACKAGE_ARCHITECTURE all)
    if(TARGET palpate_python)
      list(APPEND CPACK_COMPONENTS_ALL python)
      set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-palpate)
      set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
      set(CPACK_DEBIAN_PYTHON_PACKAGE_SHLIBDEPS ON)
      set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS "python3 (>= 3.11), python3-numpy")
      # Only suggested: with what they recommend in turn (numba, LLVM) they are 314 MB, numpy 48.
      set(CPACK_DEBIAN_PYTHON_PACKAGE_SUGGESTS "python3-pandas, python3-matplotlib")
    endif()
  endif()
  include(CPack)
  cpack_add_component_group(command)
  cpack_add_component(tools GROUP command)
  cpack_add_component(udev GROUP command)
  foreach(single dev doc python)
    cpack_add_component(${single})
  endforeach()
endif()

function(palpate_print_summary)
  get_property(modules GLOBAL PROPERTY PALPATE_MODULES)
  list(TRANSFORM modules REPLACE "^palpate_" "")
  list(JOIN modules " " module_list)
  message(STATUS "palpate ${PROJECT_VERSION}")
  message(STATUS "  build       ${CMAKE_BUILD_TYPE}, ${CMAKE_CXX_COMPILER_ID} ${CMAKE_CXX_COMPILER_VERSION}, "
                 "sanitizer: ${PALPATE_SANITIZE}, warnings as errors: ${PALPATE_WARNINGS_AS_ERRORS}")
  message(STATUS "  parts       baselines ${PALPATE_BUILD_BASELINES}, experiments ${PALPATE_BUILD_EXPERIMENTS}, "
                 "pcd ${PALPATE_WITH_PCD}, voronoi ${PALPATE_WITH_VORONOI}, dem ${PALPATE_WITH_DEM}, devices ${PALPATE_WITH_DEVICES}, tests ${PALPATE_BUILD_TESTS}, benchmarks ${PALPATE_BUILD_BENCHMARKS}, "
                 "fuzzers ${PALPATE_BUILD_FUZZERS}")
  message(STATUS "  modules     ${module_list}")
endfunction()
