# SPDX-License-Identifier: Apache-2.0
# Installation in three components, each a Debian package: the program, the plug-in, and the development files for hosts. Documented in
# README.md in this folder. No installed file contains a path of the build machine.
set(CMAKE_SKIP_INSTALL_ALL_DEPENDENCY ON) # installing does not build the tests

file(STRINGS core/plugin/marram_plugin.h marram_ABI_VERSION REGEX "^#define MARRAM_ABI_VERSION")
string(REGEX MATCH "[0-9]+" marram_ABI_VERSION "${marram_ABI_VERSION}")
string(REGEX MATCH "^[0-9]+" marram_EMBREE_MAJOR "${embree_VERSION}")
set(marram_CONFIG_FOLDER ${CMAKE_INSTALL_LIBDIR}/cmake/marram)
file(RELATIVE_PATH marram_PREFIX_FROM_PKGCONFIG ${CMAKE_INSTALL_FULL_LIBDIR}/pkgconfig ${CMAKE_INSTALL_PREFIX})
# embree.h selects the newest Embree by default; a host must use the version that the plug-in was built with.
set(marram_DEFINITIONS "")
if(marram_EMBREE_MAJOR EQUAL 3)
  set(marram_DEFINITIONS MARRAM_EMBREE3)
  set(marram_PKGCONFIG_DEFINITIONS -DMARRAM_EMBREE3)
endif()

install(TARGETS marram RUNTIME COMPONENT program)
install(TARGETS marram_images LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/marram COMPONENT program)
if(TARGET marram_view) # with three.js inside, whose licence goes with it
  install(TARGETS marram_view LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/marram COMPONENT program)
  install(FILES /usr/share/doc/libjs-three/copyright DESTINATION ${CMAKE_INSTALL_DOCDIR} RENAME three.js.copyright
          COMPONENT program OPTIONAL)
endif()
install(DIRECTORY core/integrations/blender/marram_blender DESTINATION ${CMAKE_INSTALL_DATADIR}/marram/blender COMPONENT program
        PATTERN __pycache__ EXCLUDE)
# Sample scenes with the files that they name, and the page that explains them; not its pictures.
install(DIRECTORY scenes/ DESTINATION ${CMAKE_INSTALL_DATADIR}/marram/scenes COMPONENT program
        PATTERN golden EXCLUDE PATTERN pictures EXCLUDE PATTERN "*.states" EXCLUDE PATTERN run EXCLUDE PATTERN setup EXCLUDE)
# Manual pages and completion, made by the program itself while it is installed.
set(marram_MADE ${CMAKE_BINARY_DIR}/installed/made)
install(CODE "
  function(marram_print file)
    execute_process(COMMAND \${CMAKE_COMMAND} -E env --unset=MARRAM_PLUGIN_PATH \"$<TARGET_FILE:marram>\" \${ARGN}
                    OUTPUT_FILE \"\${file}\" RESULT_VARIABLE result)
    if(NOT result EQUAL 0)
      message(FATAL_ERROR \"marram \${ARGN}: exit code \${result}: build the targets marram and marram_procedural\")
    endif()
  endfunction()
  file(REMOVE_RECURSE \"${marram_MADE}\")
  file(MAKE_DIRECTORY \"${marram_MADE}/man\")
  marram_print(\"${marram_MADE}/names\" man --out \"${marram_MADE}/man\")
  marram_print(\"${marram_MADE}/marram\" completion bash)
  marram_print(\"${marram_MADE}/_marram\" completion zsh)
  # Debian's zsh looks for what packages bring in another folder than for what is installed by hand.
  set(zsh site-functions)
  if(CMAKE_INSTALL_PREFIX MATCHES \"/usr$\")
    set(zsh vendor-completions)
  endif()
  set(data \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_DATADIR}\")
  file(GLOB pages \"${marram_MADE}/man/*.1\")
  file(INSTALL \${pages} DESTINATION \"\${data}/man/man1\")
  file(INSTALL \"${marram_MADE}/marram\" DESTINATION \"\${data}/bash-completion/completions\")
  file(INSTALL \"${marram_MADE}/_marram\" DESTINATION \"\${data}/zsh/\${zsh}\")
" COMPONENT program)
install(TARGETS marram_procedural LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/marram COMPONENT plugin)
if(MARRAM_HAS_OPENVDB)
  install(TARGETS marram_rock LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/marram COMPONENT plugin)
  install(TARGETS marram_level_set LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/marram COMPONENT program)
endif()
# Hosts are linked with it, so it is where the linker looks. Its number is that of the contract.
set_target_properties(marram_host PROPERTIES SOVERSION ${marram_ABI_VERSION})
install(TARGETS marram_host LIBRARY COMPONENT plugin NAMELINK_COMPONENT development)
install(FILES core/plugin/embree.h core/plugin/marram_types.h core/plugin/marram_plugin.h
              core/plugin/marram_host.h
        DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/marram COMPONENT development)

include(CMakePackageConfigHelpers)
configure_package_config_file(core/integrations/marram-config.cmake.in ${CMAKE_BINARY_DIR}/installed/marram-config.cmake
                              INSTALL_DESTINATION ${marram_CONFIG_FOLDER}
                              PATH_VARS CMAKE_INSTALL_INCLUDEDIR CMAKE_INSTALL_LIBDIR)
write_basic_package_version_file(${CMAKE_BINARY_DIR}/installed/marram-config-version.cmake COMPATIBILITY SameMinorVersion)
configure_file(core/integrations/marram.pc.in ${CMAKE_BINARY_DIR}/installed/marram.pc @ONLY)
install(FILES ${CMAKE_BINARY_DIR}/installed/marram-config.cmake ${CMAKE_BINARY_DIR}/installed/marram-config-version.cmake
        DESTINATION ${marram_CONFIG_FOLDER} COMPONENT development)
install(FILES ${CMAKE_BINARY_DIR}/installed/marram.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT development)

# Packages: `cpack` in the build folder.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME marram)
set(CPACK_PACKAGE_CONTACT "Marram maintainers <maintainers@localhost>" CACHE STRING "who maintains the Debian packages")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_COMPONENTS_ALL program plugin development)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(marram_PROGRAM_PACKAGE marram)
set(marram_PLUGIN_PACKAGE libmarram-procedural)
set(marram_DEVELOPMENT_PACKAGE libmarram-procedural-dev)
set(CPACK_COMPONENT_PROGRAM_DESCRIPTION "path tracer with wind on hair, fur and grass at render time
Renders and bakes scenes whose grooms are expanded and blown while the
scene is built.")
set(CPACK_COMPONENT_PLUGIN_DESCRIPTION "wind on hair, fur and grass, and deserts, for any renderer
The procedural library that marram loads. Other renderers load it, too: it
needs Embree, and nothing of marram. With it comes the library that sets its
values by name.")
set(CPACK_COMPONENT_DEVELOPMENT_DESCRIPTION "wind on hair, fur and grass: headers for renderers
The contract between a renderer and a procedural library as C headers, with
CMake and pkg-config files and an example of a host.")
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_PLUGIN_PACKAGE_SECTION libs)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
# dpkg-shlibdeps finds dependencies on libraries; dependencies between these packages are listed here.
set(CPACK_DEBIAN_PROGRAM_PACKAGE_DEPENDS "libmarram-procedural (= ${PROJECT_VERSION})")
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SUGGESTS "blender, python3-numpy")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS "libmarram-procedural (= ${PROJECT_VERSION}), libembree-dev")
foreach(part PROGRAM PLUGIN DEVELOPMENT)
  set(CPACK_DEBIAN_${part}_PACKAGE_NAME ${marram_${part}_PACKAGE})
  string(TOLOWER ${part} component)
  install(FILES .LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${marram_${part}_PACKAGE} RENAME copyright COMPONENT ${component})
endforeach()
install(FILES core/integrations/README.md DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${marram_DEVELOPMENT_PACKAGE} COMPONENT development)
install(DIRECTORY core/integrations/example core/integrations/embree_viewer
        DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${marram_DEVELOPMENT_PACKAGE} COMPONENT development)
include(CPack)
