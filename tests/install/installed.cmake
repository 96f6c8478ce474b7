# SPDX-License-Identifier: Apache-2.0
# Installs into a folder, moves it, and builds and runs core/integrations/example against it: its CVs must be bit-identical to those that the
# installed program bakes. cmake -D SOURCE=... -D BUILD=... -D WORK=... -D CC=... -D CXX=... -P installed.cmake
cmake_minimum_required(VERSION 3.25)

# Runs a command and sets `out` to its output. CODE: the expected exit code; ENV: environment variables of the command.
function(run code)
  cmake_parse_arguments(PARSE_ARGV 1 run "" "FOLDER" "ENV;COMMAND")
  if(NOT run_FOLDER)
    set(run_FOLDER ${WORK})
  endif()
  execute_process(COMMAND ${CMAKE_COMMAND} -E env --unset=MARRAM_PLUGIN_PATH ${run_ENV} ${run_COMMAND} WORKING_DIRECTORY ${run_FOLDER}
                  RESULT_VARIABLE result OUTPUT_VARIABLE out ERROR_VARIABLE out)
  if(NOT result STREQUAL code)
    message(FATAL_ERROR "exit code ${result}, not ${code}, of ${run_ENV} ${run_COMMAND}\n${out}")
  endif()
  set(out "${out}" PARENT_SCOPE)
endfunction()

function(expect text part)
  string(FIND "${text}" "${part}" at)
  if(at EQUAL -1)
    message(FATAL_ERROR "\"${part}\" is not in\n${text}")
  endif()
endfunction()

file(REMOVE_RECURSE ${WORK})
file(MAKE_DIRECTORY ${WORK}/plugins)
run(0 COMMAND ${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/first)
file(RENAME ${WORK}/first ${WORK}/prefix)
set(prefix ${WORK}/prefix)
set(program ${prefix}/bin/marram)
set(plugin ${prefix}/lib/marram/libmarram_procedural.so)

# No installed file contains a path of this machine. The program finds the image library next to the plug-in; all others are system libraries.
run(1 COMMAND grep -rlF -e ${BUILD} -e ${SOURCE} ${prefix})
foreach(binary ${program} ${plugin} ${prefix}/lib/marram/libmarram_rock.so ${prefix}/lib/marram/libmarram_level_set.so
               ${prefix}/lib/marram/libmarram_view.so ${prefix}/lib/marram/libmarram_images.so ${prefix}/lib/libmarram_host.so)
  run(0 COMMAND readelf -d ${binary})
  string(REGEX MATCHALL "R(UN)?PATH[^\n]*" paths "${out}")
  if(paths AND NOT (binary STREQUAL program AND paths MATCHES "^RUNPATH\\) +Library runpath: .\\$ORIGIN/../lib/marram.$")
     AND NOT (binary STREQUAL plugin AND paths MATCHES "^RUNPATH\\) +Library runpath: .\\$ORIGIN.$"))
    message(FATAL_ERROR "${binary} has a RUNPATH:\n${paths}")
  endif()
endforeach()

# Compiles each header by itself, as C99 and as C++20, with the flags of pkg-config.
run(0 ENV PKG_CONFIG_PATH=${prefix}/lib/pkgconfig COMMAND pkg-config --cflags marram)
separate_arguments(flags UNIX_COMMAND "${out}")
run(0 ENV PKG_CONFIG_PATH=${prefix}/lib/pkgconfig COMMAND pkg-config --variable=plugin marram)
string(STRIP "${out}" out)
file(REAL_PATH "${out}" found)
if(NOT found STREQUAL plugin)
  message(FATAL_ERROR "pkg-config says the plug-in is ${found}")
endif()
foreach(header embree marram_types marram_plugin marram_host)
  file(WRITE ${WORK}/${header}.c "#include <marram/${header}.h>\nint main(void) { return 0; }\n")
  file(COPY_FILE ${WORK}/${header}.c ${WORK}/${header}.cpp)
  run(0 COMMAND ${CC} -std=c99 -Wall -Wextra -Wpedantic -Werror -fsyntax-only ${flags} ${header}.c)
  run(0 COMMAND ${CXX} -std=c++20 -Wall -Wextra -Wpedantic -Werror -fsyntax-only ${flags} ${header}.cpp)
endforeach()

# Builds the example as a user would.
set(example ${prefix}/share/doc/libmarram-procedural-dev/example)
run(0 COMMAND ${CMAKE_COMMAND} -S ${example} -B ${WORK}/example -G Ninja -DCMAKE_C_COMPILER=${CC} -DCMAKE_BUILD_TYPE=Release
              "-DCMAKE_C_FLAGS=-Wall -Wextra -Wpedantic -Werror" -DCMAKE_PREFIX_PATH=${prefix})
run(0 COMMAND ${CMAKE_COMMAND} --build ${WORK}/example)
run(0 COMMAND ${WORK}/example/host meadow.ppm strands.bin)
file(SIZE ${WORK}/meadow.ppm size)
if(NOT size EQUAL 172815) # "P6\n320 180\n255\n" and 3 bytes per pixel
  message(FATAL_ERROR "the picture has ${size} bytes")
endif()
run(0 COMMAND ${program} bake ${example}/meadow.toml -o meadow.hair --frame 12 --quiet)
file(SIZE ${WORK}/meadow.hair baked)
file(SIZE ${WORK}/strands.bin strands)
math(EXPR strands "${strands} + 128") # the header of .hair
if(NOT baked EQUAL strands OR strands LESS 256000)
  message(FATAL_ERROR "${baked} bytes were baked, ${strands} are the host's")
endif()
run(0 COMMAND cmp -i 128:0 meadow.hair strands.bin)

# The same with what pkg-config says alone.
run(0 ENV PKG_CONFIG_PATH=${prefix}/lib/pkgconfig COMMAND pkg-config --libs marram)
separate_arguments(libraries UNIX_COMMAND "${out}")
run(0 ENV PKG_CONFIG_PATH=${prefix}/lib/pkgconfig COMMAND pkg-config --variable=plugin marram)
string(STRIP "${out}" out)
run(0 COMMAND ${CC} -std=c99 ${flags} "-DPLUGIN=\"${out}\"" ${example}/host.c -o linked ${libraries})
run(0 ENV LD_LIBRARY_PATH=${prefix}/lib COMMAND ${WORK}/linked meadow.ppm linked.bin)
run(0 COMMAND cmp linked.bin strands.bin)

# Manual pages, completion and sample scenes with their page.
foreach(file man/man1/marram.1 man/man1/marram-render.1 man/man1/marram-bake.1 bash-completion/completions/marram zsh/site-functions/_marram
             marram/scenes/README.md marram/scenes/default.toml)
  if(NOT EXISTS ${prefix}/share/${file})
    message(FATAL_ERROR "share/${file} is not installed")
  endif()
endforeach()
file(READ ${prefix}/share/bash-completion/completions/marram script)
expect("${script}" "complete -F _marram marram")
file(READ ${prefix}/share/man/man1/marram-render.1 page)
expect("${page}" "allow\\-library")
foreach(scene leopard wind_stars) # the files that they name are there
  run(0 COMMAND ${program} info --keys ${prefix}/share/marram/scenes/${scene}.toml)
endforeach()

# The search path of a library that a scene names, and of the program's own libraries.
set(pyramid "[camera]\nposition = [0, 1, 4]\ntarget = [0, 0, 0]\n[[procedural]]\nname = \"tomb\"\ntype = \"pyramid\"\nlibrary = \"libmesh_plugin.so\"\n")
string(APPEND pyramid "[[procedural]]\nname = \"grass\"\ntype = \"groom\"\non = \"tomb\"\ncount = 10\nlength = 0.1\nwidth = 0.01\n")
file(WRITE ${WORK}/pyramid.toml "${pyramid}")
file(COPY ${BUILD}/libmesh_plugin.so DESTINATION ${WORK}/plugins)
run(2 COMMAND ${program} bake pyramid.toml -o pyramid.hair --quiet)
expect("${out}" "pyramid.toml:7:11: there is no file")
expect("${out}" "MARRAM_PLUGIN_PATH")
run(0 ENV MARRAM_PLUGIN_PATH=/nowhere::${WORK}/plugins COMMAND ${program} bake pyramid.toml -o pyramid.hair --quiet)
file(RENAME ${plugin} ${WORK}/plugins/libmarram_procedural.so)
run(2 COMMAND ${program} info groom)
expect("${out}" "libmarram_procedural.so")
run(0 ENV MARRAM_PLUGIN_PATH=${WORK}/plugins COMMAND ${program} info groom)
