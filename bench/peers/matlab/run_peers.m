function run_peers(folder)
% RUN_PEERS  Fit the peer table's data with MATLAB's toolboxes and write result files for run.py --add.
%
%   run_peers('../data') reads coulomb.mat, disturbance.mat and reversals.mat, which make_data.py has written, and writes
%   results_matlab.csv (System Identification Toolbox) and results_contsid.csv (CONTSID) into the current folder.
%   A toolbox that isn't there gives rows whose status says so.
%
%   These scripts were written from the toolboxes' documentation and have NOT been run under MATLAB.
matlab_methods = {'MATLAB procest P1ID on position', @fit_procest
                  'MATLAB tfest(1,0) on speed', @(t, u, y) fit_tfest(t, u, y, false)
                  'MATLAB tfest(1,0) on speed, detrended', @(t, u, y) fit_tfest(t, u, y, true)};
contsid_methods = {'CONTSID tfsrivc(1,0) on speed', @(t, u, y) fit_tfsrivc(t, u, y, false)
                   'CONTSID tfsrivc(1,0) on speed, detrended', @(t, u, y) fit_tfsrivc(t, u, y, true)};
write_results('results_matlab.csv', 'matlab', matlab_methods, folder);
write_results('results_contsid.csv', 'contsid', contsid_methods, folder);
end

function write_results(name, tool, methods, folder)
file = fopen(name, 'w');
fprintf(file, ['date,set,run,tool,method,status,gain,time_constant,gain_low,gain_high,' ...
               'time_constant_low,time_constant_high,interval_from,seconds,note\n']);
sets = {'coulomb', 'disturbance', 'reversals'};
for s = 1:numel(sets)
    data = load(fullfile(folder, [sets{s} '.mat']));
    for m = 1:size(methods, 1)
        for run = 1:size(data.u, 1)
            position = (data.counts(run, :).' + 0.5) * data.quantum;
            write_row(file, sets{s}, run - 1, tool, methods(m, :), data.t(:), data.u(run, :).', position);
        end
    end
end
fclose(file);
end

function write_row(file, set, run, tool, method, t, u, position)
start = tic;
status = 'ok';
answer = {};
try
    [value, sd] = method{2}(t, u, position);
    ends = [value(1) - 1.959964 * sd(1), value(1) + 1.959964 * sd(1), ...
            value(2) - 1.959964 * sd(2), value(2) + 1.959964 * sd(2)];
    answer = num2cell([value(1), value(2), ends]);
catch problem
    status = ['failed: ' regexprep(problem.message, '[\s,"]+', ' ')];
end
cells = repmat({''}, 1, 6);
for k = 1:numel(answer)
    cells{k} = sprintf('%.17g', answer{k});
end
from = '';
if strcmp(status, 'ok')
    from = 'tool';
end
fprintf(file, '%s,%s,%d,%s,"%s","%s",%s,%s,%s,%s,%s,%s,%s,%.6g,\n', datestr(now, 'yyyy-mm-dd'), set, run, tool, ...
        method{1}, status, cells{:}, from, toc(start));
end
